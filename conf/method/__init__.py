"""Presets of methods: the settings of papers."""
