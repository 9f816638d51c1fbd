"""The suffixes of files that are read; this module imports nothing, so that whoever lists files may ask it."""

SCENES = (".glb", ".gltf", ".3mf", ".dae")
MESH_SUFFIXES = (".ply", ".obj", ".stl", ".off", *SCENES)
