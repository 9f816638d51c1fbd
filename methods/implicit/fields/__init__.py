"""The fields that are fitted."""
