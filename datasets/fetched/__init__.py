"""What datasets that are fetched at set-up are made of: downloads, packages, and their formats."""
