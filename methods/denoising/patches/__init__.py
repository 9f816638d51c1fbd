"""A cloud taken apart into patches, and put together again."""
