"""Metrics: a name is a formula."""
