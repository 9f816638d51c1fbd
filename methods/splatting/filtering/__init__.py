"""Clouds that are filtered through images of them."""
