"""Fitting a source to a target: welded meshes, springs, nearest points, linear systems."""
