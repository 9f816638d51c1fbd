"""Presets of sensors: the settings of papers, and scanners."""
