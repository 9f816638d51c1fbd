"""Points on the zero level of a field: projection, even spacing, insertion (thesis 4.2.1)."""
