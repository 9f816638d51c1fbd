"""Human figures: bodies, builds, poses and their skeleton."""
