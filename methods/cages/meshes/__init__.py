"""Initial cages, and meshes in the unit of a network."""
