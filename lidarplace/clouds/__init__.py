"""Point clouds: rays that are cast at boxes, their returns, and clouds that were recorded."""
