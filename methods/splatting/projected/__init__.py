"""Points rendered by projection as smoothed depths; depths of a visual hull, and initial points on it."""
