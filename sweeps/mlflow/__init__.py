"""What MLflow is told of a sweep and of its trials."""
