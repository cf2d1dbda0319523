"""Detections that look as if another convention was meant, compared with the labels."""
