"""Methods that deform a mesh until its images look like those given: differentiable mesh renderers."""
