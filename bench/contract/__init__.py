"""The interface for plugin authors: shapes, cases, runs, sensors and tasks."""
