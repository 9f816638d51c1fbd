"""Search for good parameters of a method on train shapes, and evaluate them on others."""
