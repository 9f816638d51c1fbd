"""Patches of point clouds: cutting, normalising, putting together."""
