"""Hydra: what is asked for becomes jobs."""
