"""The renderer: oriented points to images, and gradients of images back to points, normals and attributes."""
