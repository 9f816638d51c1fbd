"""Solids by booleans."""
