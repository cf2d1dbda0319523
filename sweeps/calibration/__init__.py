"""Detection curves from the detections of a sweep: hits, found objects, and a check."""
