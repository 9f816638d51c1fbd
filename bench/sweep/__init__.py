"""Hydra: from requests to jobs."""
