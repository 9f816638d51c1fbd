"""The common parts of compiled loops."""
