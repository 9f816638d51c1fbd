"""Pseudo-methods: what a metric must rank where it belongs."""
