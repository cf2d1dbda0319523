"""Plotly figures: of sweeps, of searches, and what they share."""
