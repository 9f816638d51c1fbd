"""The renderer of :mod:`..renderer` in operations of torch: the same images and gradients, on CPU and CUDA."""
