"""Common parts of figures: style, labels, maps and the picture of a rig."""
