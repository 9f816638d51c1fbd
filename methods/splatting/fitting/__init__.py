"""Fitting points to images."""
