"""Sensors: point clouds and images of a shape."""
