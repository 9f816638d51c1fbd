"""Shapes carved out of the unit ball by silhouettes and colours: what visual_hull and space_carving share."""
