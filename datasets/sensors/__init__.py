"""Sensors: how a shape becomes a point cloud."""
