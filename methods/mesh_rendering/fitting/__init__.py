"""Fitting meshes to images."""
