"""Meshes that are fitted to images."""
