"""Networks that predict cages."""
