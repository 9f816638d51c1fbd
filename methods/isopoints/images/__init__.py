"""Fitting a field to images: rays, iso-points, or volumes (thesis 4.2.1 and 4.2.2)."""
