"""Regularisers that keep points on a surface, and apart from each other, while they are fitted to images."""
