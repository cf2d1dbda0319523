"""Tasks run: backends, workers, order, what they need, progress and failures."""
