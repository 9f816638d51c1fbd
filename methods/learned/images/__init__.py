"""Images: filters, and the order in which they are used."""
