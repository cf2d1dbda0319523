"""Evaluation of detections from elsewhere on the test frames of a log."""
