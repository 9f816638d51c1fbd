"""Pseudo-methods: outputs of known quality, to check the ranks that metrics give."""
