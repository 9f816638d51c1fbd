"""Files: meshes and point clouds are read and written here."""
