"""From rows to tables: who is better, by how much, how surely."""
