"""Cages around bodies: one for a template, fitted to other characters, and posed."""
