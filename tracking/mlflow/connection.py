"""Connection to MLflow that fails at once, and whether trying again makes sense."""

import logging
import os
import re
import shlex
import socket
import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from lidarplace.base.errors import InputError
from lidarplace.base.optional import needs
from lidarplace.files.atomic import temporary
from lidarplace.files.regular import regular
from lidarplace.files.secret_urls import public_url
from tracking.mlflow.uri import is_server, sqlite_file, sqlite_uri


class Away(Exception):
    """Failure to reach MLflow now; what was sent may or may not have arrived."""


def connect(uri: str) -> Any:
    """Open an MLflow client; fail at once where MLflow itself would try for minutes.

    Raises as `is_away` says, and ValueError if a package is missing."""
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"
    os.environ["MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT"] = "true"
    os.environ["MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR"] = "false"
    os.environ["MLFLOW_HTTP_REQUEST_MAX_RETRIES"] = "0"
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "30")
    os.environ.setdefault("PGCONNECT_TIMEOUT", "10")
    from mlflow import MlflowClient  # heavy, and reads the environment when imported

    # A lost connection is reported in one line, without a password; other steps are no news.
    for logger in ("mlflow.store.db.utils", "mlflow.system_metrics", "alembic"):
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    database = sqlite_file(uri)
    if database is not None and database.exists():
        regular(database)
    elif database is not None:
        _create(database)
    if not is_server(uri):
        _try_database(uri)
    return MlflowClient(tracking_uri=uri)


def _create(database: Path) -> None:
    """Make a SQLite database with MLflow's tables, in one step for everybody else.

    MLflow makes them in many: a process that was killed on its way, or a second one that does
    the same, would leave a database that no MLflow can open again."""
    from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

    partial = temporary(database)
    # MLflow writes the folder of artifacts into SQL between quotes: in a URI none is left of them.
    artifacts = (database.parent / "artifacts").absolute().as_uri()
    try:
        SqlAlchemyStore(sqlite_uri(partial), artifacts)
        with suppress(FileExistsError):  # another process was faster
            os.link(partial, database)
    finally:
        for path in partial.parent.glob(f"{partial.name}*"):  # SQLite's own files too
            path.unlink(missing_ok=True)


def _try_database(uri: str) -> None:
    import sqlalchemy
    from sqlalchemy import event
    from sqlalchemy.engine import Engine

    if not event.contains(Engine, "connect", _sync_less):
        event.listen(Engine, "connect", _sync_less)
    try:
        engine = sqlalchemy.create_engine(uri)
    except ModuleNotFoundError as error:
        missing = needs(error) or f"needs the package {error.name}"
        raise InputError(missing, place=public_url(uri)) from error
    try:
        sqlalchemy.inspect(engine).get_table_names()
    finally:
        engine.dispose()


def _sync_less(connection: Any, _record: Any) -> None:
    """Let SQLite wait for the disk once a commit, not three times: MLflow commits often.

    A killed process loses nothing by it; what a power cut takes back is found missing again."""
    if isinstance(connection, sqlite3.Connection):
        connection.execute("PRAGMA synchronous = NORMAL")
        if connection.execute("PRAGMA journal_mode").fetchone() == ("delete",):
            connection.execute("PRAGMA journal_mode = PERSIST")


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def is_away(error: Exception, uri: str) -> bool:
    """Tell whether the same call may succeed later.

    A folder that cannot be written is not away: nobody may ever mend it, and others would wait."""
    from mlflow.exceptions import InvalidUrlException, MlflowException
    from requests import HTTPError, RequestException
    from sqlalchemy.exc import InterfaceError, OperationalError

    if isinstance(error, InvalidUrlException):
        return False
    if isinstance(error, HTTPError) and error.response is not None:  # of an artifact
        return error.response.status_code in (401, 403)
    lost = (OperationalError, InterfaceError, ConnectionError, TimeoutError, socket.gaierror)
    if any(isinstance(cause, (*lost, RequestException)) for cause in _causes(error)):
        return True
    if not isinstance(error, MlflowException) or not is_server(uri):
        return False
    status = error.get_http_status_code()
    return status >= 500 or status in (408, 429) or is_forbidden(error)


def is_busy(error: Exception) -> bool:
    """Tell whether another process has locked a local database."""
    codes = (getattr(cause, "sqlite_errorcode", 0) & 0xFF for cause in _causes(error))
    return any(code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED) for code in codes)


def _other_schema(revision: str, uri: str) -> str:
    """Explain whether a newer or an older MLflow wrote a database, and how to go on.

    MLflow itself asks for an upgrade of the database in both cases."""
    import mlflow
    from alembic.script import ScriptDirectory
    from alembic.util import CommandError

    migrations = Path(mlflow.__file__).parent / "store" / "db_migrations"
    try:
        ScriptDirectory(str(migrations)).get_revision(revision)
    except CommandError:
        newer = f"a newer MLflow than this one, {mlflow.__version__}, wrote this database"
        return f"{newer}; pip install --upgrade mlflow, or set another tracking.uri"
    upgrade = f"mlflow db upgrade {shlex.quote(public_url(uri))}"
    return f"an older MLflow wrote this database; copy it, then run: {upgrade}"


def is_server_error(error: Exception) -> bool:
    """Tell whether the server answered 500, as if it cannot write an artifact (503: away)."""
    from urllib3.exceptions import ResponseError

    return reason(error) == ResponseError.SPECIFIC_ERROR.format(status_code=500)


def is_forbidden(error: Exception) -> bool:
    """Tell whether the server wants other credentials, whatever is sent."""
    from mlflow.exceptions import MlflowException

    return isinstance(error, MlflowException) and error.get_http_status_code() in (401, 403)


_SCHEMA = re.compile(r"database schema \(found version (\w+), but expected")


def reason(error: BaseException, uri: str = "") -> str:
    """Return the innermost reason in one line; `uri`: of the database that another MLflow wrote."""
    *_, first = _causes(error)
    message = " ".join(str(first).split()) or type(first).__name__
    if schema := _SCHEMA.search(message):
        return _other_schema(schema[1], uri)
    if type(first) is sqlite3.DatabaseError:  # its subclasses are of other faults than the file's
        message += (
            "; restore a copy, or move the file away: the next run of the sweep fills a new one"
        )
    return message
