"""Building blocks of datasets that are fetched at set-up: downloads, packages, and their formats."""
