"""Learned denoisers of point clouds."""
