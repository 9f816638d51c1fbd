"""Coordinates of points in cages, differentiable in both."""
