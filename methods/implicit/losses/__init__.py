"""Eq. 4.4 and its guidance."""
