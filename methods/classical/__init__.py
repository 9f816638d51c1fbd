"""Classical methods: well-kept libraries behind one interface."""
