"""What everything else stands on: the ROI, ranges of numbers, names, metrics, the registry."""
