"""Output of a search: terminal, run folder, tables, figures, MLflow."""
