"""From the points of a grid to tasks."""
