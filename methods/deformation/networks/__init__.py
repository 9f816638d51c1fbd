"""The networks that deform, and the preparation of shapes for them."""
