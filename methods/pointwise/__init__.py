"""Learned reconstruction without a fit: a network says of each place how far the surface is, and on which side."""
