"""Code that all families share."""
