"""Deformation by cages: chapter 5.1 of the thesis."""
