"""Datasets: procedural shapes, and files of the user."""
