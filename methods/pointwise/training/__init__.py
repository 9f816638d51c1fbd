"""Training data and losses of the networks."""
