"""Networks from points around a place to its signed distance."""
