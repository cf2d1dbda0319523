"""Folders whose names mean something in an address, in SQL or to a shell."""

import sqlite3
from pathlib import Path

import pytest
from sqlalchemy.engine import make_url

from sweeps.execution import checks
from tests.mlflow_database import write_database
from tests.refused import refused
from tests.tracking.mlflow_runs_of import assert_logged_once, logged, trial_of
from tracking.mlflow.uri import absolute_uri, sqlite_file, sqlite_uri


def test_mlflow_keeps_runs_in_a_folder_of_any_name(tmp_path, monkeypatch):
    name = "a?b%20c%41'\"d e#f:g 100%ü@[x]$1&y=z"
    (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / name)  # MLflow writes the working folder into SQL, too
    uri = absolute_uri(sqlite_uri(Path("runs/mlflow.db")))
    assert make_url(uri).database == f"{tmp_path / name}/runs/mlflow.db" == str(sqlite_file(uri))
    assert logged(uri, Path("runs/demo"), [trial_of(1)]).undelivered == 0
    assert_logged_once(uri, range(1, 2))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert [path.name for path in Path().iterdir()] == ["runs"]


def test_a_local_database_that_cannot_be_made_is_refused_at_once(tmp_path):
    (tmp_path / "taken.db").mkdir()
    with refused("taken.db"):
        logged(sqlite_uri(tmp_path / "taken.db"), tmp_path)
    with refused(("", "tracking.uri", "'sqlite:///a?b/mlflow.db'")):
        absolute_uri("sqlite:///a?b/mlflow.db")


@pytest.mark.parametrize(
    ("revision", "advice"),
    [
        ("deadbeef1234", "pip install --upgrade mlflow"),
        ("451aebb31d03", "mlflow db upgrade 'sqlite"),
    ],
)
def test_a_database_of_another_mlflow_is_named(tmp_path, revision, advice):
    file = tmp_path / f"{revision} ?" / "mlflow.db"
    write_database(file)
    with sqlite3.connect(file) as database:
        database.execute("UPDATE alembic_version SET version_num = ?", [revision])
    check = checks.mlflow(sqlite_uri(file))
    assert check.state == "missing"
    assert advice in check.found
    with refused(advice):
        logged(sqlite_uri(file), tmp_path)
