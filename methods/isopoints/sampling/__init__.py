"""Points on the zero level of a field: projection, even spacing, more of them (thesis 4.2.1)."""
