"""Detections of other programs: the boxes that somebody's detector found in the frames of a log."""
