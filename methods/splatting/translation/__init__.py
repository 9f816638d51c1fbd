"""A network that turns images of noisy clouds into images of clean ones, and how it is trained (Isola et al. 2017)."""
