"""Plots of scores: for each kind a table of the drawn numbers, and the drawing of the table."""
