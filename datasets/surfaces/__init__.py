"""Surfaces that are known exactly."""
