"""Dashboard: MLflow on the runs of sweeps, `lidarplace dashboard runs/mlflow.db`."""

import os
import sys
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from lidarplace.base.errors import InputError
from lidarplace.base.ranges import PORT
from lidarplace.command_line.port import free_port
from lidarplace.command_line.verbs import new_app, verb, within, wrong
from lidarplace.files.secret_urls import hide_secrets, public_url
from tracking.mlflow.connection import connect, reason
from tracking.mlflow.experiment_page import VIEW_TAG, page_of
from tracking.mlflow.uri import absolute_uri, is_server, sqlite_file, sqlite_uri
from tracking.run_folders.json_file import Part, read_result_file

app = new_app()

FIRST_PORT = 5000


@verb(app, "", "runs/grid", "runs/mlflow.db --port 8000", failed="MLflow did not start")
def dashboard(
    where: Annotated[
        str, typer.Argument(help="folder of a sweep, file of a database, or MLflow's tracking URI")
    ] = "runs/mlflow.db",
    port: Annotated[
        int | None, typer.Option(help="5000, or the next free one", callback=within(PORT))
    ] = None,
) -> None:
    """Start MLflow on this machine only, and print the address. Ctrl-C stops it.

    For a folder, the address is the page of its sweep, otherwise that of the latest sweep."""
    uri = where
    try:
        uri, name = _tracking(where)
        client = connect(uri)
        page = _page(client, name)
        port = None if is_server(uri) else free_port(port, FIRST_PORT)
    except ValueError as error:
        wrong(error)
    except ModuleNotFoundError:  # reported in one line for all verbs
        raise
    except Exception as error:  # of MLflow, SQLAlchemy or requests, by what is wrong there
        wrong(hide_secrets(f"{where}: {reason(error, uri)}", where))
    if port is None:
        print(public_url(uri).rstrip("/") + page)
        return
    print(f"http://127.0.0.1:{port}{page}\nMLflow starts there in some seconds; Ctrl-C ends it.")
    serve(uri, port)


def serve(uri: str, port: int) -> NoReturn:
    """Become MLflow's server for a database, on the loopback interface."""
    sys.stdout.flush()
    settings = {
        # Not as an argument, where every user of the machine could read a password.
        "MLFLOW_BACKEND_STORE_URI": uri,
        "MLFLOW_DISABLE_TELEMETRY": "true",
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
        "PYTHONWARNINGS": "ignore:starlette.middleware.wsgi",  # MLflow's to mend
        "UVICORN_LOG_LEVEL": "warning",
    }
    command = [sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1"]
    command += ["--port", str(port), "--workers", "1"]
    os.execve(sys.executable, command, os.environ | settings)


class _About(Part):
    """Keys of `sweep.json` or `search.json` that name MLflow's experiment."""

    name: str
    tracking_uri: str


def _tracking(where: str) -> tuple[str, str | None]:
    """Find MLflow's URI, and the experiment if `where` is the folder of a sweep or a search."""
    name = None
    if "://" in where:
        uri = absolute_uri(where)
    elif (path := Path(where)).is_dir():
        about = [path / name for name in ("sweep.json", "search.json")]
        written = [file for file in about if file.is_file()]
        if not written:
            raise InputError("no results: neither sweep.json nor search.json", place=where)
        result = read_result_file(written[0], _About)
        uri, name = absolute_uri(result.tracking_uri), result.name
    else:
        uri = absolute_uri(sqlite_uri(path))
    database = sqlite_file(uri)
    if database is not None and not (database.is_file() and database.stat().st_size):
        fault = "an empty file" if database.is_file() else "no such database"
        raise InputError(fault, place=database, fix="a sweep makes runs/mlflow.db")
    return uri, name


def _page(client: Any, name: str | None) -> str:
    """Find the page of the experiment `name`, or of the one with the latest run."""
    if name is not None:
        experiment = client.get_experiment_by_name(name)
        if experiment is None:
            raise ValueError(f"MLflow has no experiment {name!r}")
    else:
        by_id = {experiment.experiment_id: experiment for experiment in client.search_experiments()}
        latest = client.search_runs(
            list(by_id), order_by=["attributes.start_time DESC"], max_results=1
        )
        if not latest:
            return ""
        experiment = by_id[latest[0].info.experiment_id]
    return page_of(experiment.experiment_id, VIEW_TAG in experiment.tags)
