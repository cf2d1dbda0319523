"""The page of the studio: what it draws, its fields, and when they are drawn anew."""
