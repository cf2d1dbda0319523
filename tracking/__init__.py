"""Meaning of results and how they are shown: statistics, figures, reports, MLflow."""
