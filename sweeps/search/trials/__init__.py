"""The loop of a search: a study that asks, and surrogates or detectors that answer."""
