"""What compiled loops share."""
