"""What the networks learn from, and their losses."""
