"""Points that are drawn by projection as smoothed depths, and the depths of a visual hull to compare with."""
