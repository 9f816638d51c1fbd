"""Hydra configuration (YAML files beside this one)."""
