"""Learned reconstruction without a fit: a network predicts the signed distance of each query to the surface."""
