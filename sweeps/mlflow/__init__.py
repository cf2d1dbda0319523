"""Log of a sweep and its trials in MLflow."""
