"""Fitting a field to noisy points with iso-points (thesis, Eq. 4.13 to 4.16)."""
