"""Images of meshes, and gradients from the image back to the vertices."""
