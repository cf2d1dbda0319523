"""What a search has found, how robust it is, and whether detectors agree."""
