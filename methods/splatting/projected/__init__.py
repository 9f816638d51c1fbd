"""Points that are drawn by projection as smoothed depths; depths of a visual hull, and points on it to begin with."""
