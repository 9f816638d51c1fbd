"""Bases of the methods: one field fitted to one shape."""
