"""What keeps points on a surface, and apart, while images pull at them."""
