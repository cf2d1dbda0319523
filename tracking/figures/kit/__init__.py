"""What figures share: style, labels, maps and the picture of a rig."""
