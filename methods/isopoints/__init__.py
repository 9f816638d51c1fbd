"""Iso-points: points on the zero level of a field while it is fitted (thesis 4.2)."""
