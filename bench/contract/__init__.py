"""What the author of a plugin meets: shapes, cases, runs, sensors and tasks."""
