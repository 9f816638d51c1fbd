"""Points that are fitted to images."""
