"""Methods composed of other methods."""
