"""A source that is fitted to a target: welded meshes, springs, nearest points, linear systems."""
