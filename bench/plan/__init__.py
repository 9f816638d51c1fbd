"""What is to be done: cells, their limits and the keys of a run."""
