"""Images: filters of them, and which are looked at when."""
