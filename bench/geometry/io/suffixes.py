"""The suffixes of files that are read; this module imports nothing, so that listings of files may use it."""

SCENES = (".glb", ".gltf", ".3mf", ".dae")
MESH_SUFFIXES = (".ply", ".obj", ".stl", ".off", *SCENES)
