"""Values of a box log that look like another unit, origin or frame of coordinates."""
