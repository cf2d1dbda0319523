"""The networks, one a file, and what they are put together from."""
