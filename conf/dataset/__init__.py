"""Presets of datasets: mixtures with a name."""
