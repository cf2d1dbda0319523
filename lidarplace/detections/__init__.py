"""Detections of other programs in the frames of a log."""
