"""Networks that turn the points of a patch into more points."""
