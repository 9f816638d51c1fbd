"""A network that turns images of noisy clouds into images of clean ones, and its training (Isola et al. 2017)."""
