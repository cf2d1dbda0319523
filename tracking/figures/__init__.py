"""Plotly figures of sweeps and of searches, and their style.

In all of them, also those of the report's sections, `title` is plotly text, `axis` an axis'
title with its unit, `placements` all of the sweep in order, so that a placement keeps its
colour, and a `vehicle` of None a sedan."""
