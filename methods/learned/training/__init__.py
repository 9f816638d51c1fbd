"""The training loop, its batches, schedules and files."""
