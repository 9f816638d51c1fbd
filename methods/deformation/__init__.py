"""Deformation of meshes to targets: baselines of chapter 5.1."""
