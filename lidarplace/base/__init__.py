"""The base of all packages: the ROI, ranges of numbers, names, metrics, the registry."""
