"""What is logged to MLflow of a sweep and its trials."""
