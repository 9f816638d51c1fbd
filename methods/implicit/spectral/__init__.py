"""Poisson surfaces by Fourier transforms."""
