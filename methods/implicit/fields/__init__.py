"""The fitted fields."""
