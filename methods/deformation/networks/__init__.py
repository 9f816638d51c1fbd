"""The networks that deform, and how shapes are brought to them."""
