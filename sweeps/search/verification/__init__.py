"""The answer of a search: the winner, its robustness, and whether detectors agree."""
