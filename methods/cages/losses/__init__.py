"""The terms of the loss: what a deformation preserves, and its distance to the target."""
