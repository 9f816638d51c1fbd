"""Meshes of fields: marching cubes in a narrow band."""
