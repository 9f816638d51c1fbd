"""Surface splatting: a differentiable renderer of oriented points, and the methods that fit points to images."""
