"""Neural implicit surfaces: networks that are fitted to one shape."""
