"""Cages to begin with, and how a mesh is seen by a network."""
