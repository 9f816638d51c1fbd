"""Flat Gaussians with opacity, drawn by exact ray-splat intersection (Huang et al. 2024)."""
