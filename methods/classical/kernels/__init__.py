"""Fields of least norm in the space of a kernel."""
