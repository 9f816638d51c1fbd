"""The networks, and neighbours within batches."""
