"""Classical methods: well-maintained libraries behind one interface."""
