"""An empty database of MLflow: to make one computes for seconds, to copy one for none."""

import tempfile
from functools import cache
from pathlib import Path


def write_database(path: Path) -> None:
    """Write one with MLflow's tables, as its client makes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_empty())


@cache
def _empty() -> bytes:
    from mlflow import MlflowClient

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mlflow.db"
        MlflowClient(tracking_uri=f"sqlite:///{path}").search_experiments()
        return path.read_bytes()
