"""Details that families put on a base."""
