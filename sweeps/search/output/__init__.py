"""What a search shows and writes: terminal, run folder, tables, figures, MLflow."""
