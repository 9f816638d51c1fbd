"""Training on pairs of shapes."""
