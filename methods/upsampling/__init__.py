"""Learned upsampling of point clouds."""
