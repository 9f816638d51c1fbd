"""Plots of scores: for each kind a table of what is drawn, and the drawing of the table."""
