"""Expected recall: cells of object surfaces that a rig hits, and a detection curve."""
