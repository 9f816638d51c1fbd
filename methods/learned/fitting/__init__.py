"""Methods that fit a field to one shape."""
