"""The loop of a search: a study suggests trials, and surrogates or detectors evaluate them."""
