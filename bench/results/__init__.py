"""What is on disk, and what it depends on."""
