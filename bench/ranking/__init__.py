"""From rows to tables: who is better, by how much, and how certain that is."""
