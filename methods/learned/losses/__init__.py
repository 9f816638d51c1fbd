"""Losses that several families use."""
