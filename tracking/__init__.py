"""What results mean and how they are shown: statistics, figures, reports, MLflow."""
