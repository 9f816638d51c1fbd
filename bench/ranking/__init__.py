"""From rows to tables: which method is better, by how much, and how certain that is."""
