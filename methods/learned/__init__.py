"""The common parts of learned methods."""
