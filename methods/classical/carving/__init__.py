"""Shapes carved out of the unit ball by silhouettes and colours: the common part of visual_hull and space_carving."""
