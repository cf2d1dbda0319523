"""MLflow: connection, runs and their content."""
