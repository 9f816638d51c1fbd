"""Patches of point clouds: cutting, normalising, merging."""
