"""Decomposition of a cloud into patches, and its reassembly."""
