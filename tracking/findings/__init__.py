"""Findings of a sweep, each a table or a number.

`axes` are the further axes of its grid, beyond placement, detector and seed."""
