"""Losses for the training of learned upsampling."""
