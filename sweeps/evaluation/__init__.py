"""Detections from elsewhere: what they are worth on the test frames of a log."""
