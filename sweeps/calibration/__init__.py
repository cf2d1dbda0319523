"""Detection curves from the detections of a sweep: what was seen, what was found, and a check."""
