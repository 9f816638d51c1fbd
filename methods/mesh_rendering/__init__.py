"""Methods that deform a mesh until its images match the given ones: differentiable mesh renderers."""
