"""Tracking URI of MLflow: an address that can be checked, shown and opened."""

import re
from pathlib import Path
from urllib.parse import quote, unquote

from lidarplace.base.errors import InputError
from lidarplace.command_line.invocation import command
from lidarplace.files.secret_urls import check_whole, public_url


def absolute_uri(uri: str) -> str:
    """Add the driver of its database to `uri`, and make a file's path absolute, for later use.

    Raises ValueError if MLflow cannot keep runs there."""
    if "://" not in uri or uri.startswith("file:"):
        wanted = "a database or a server, such as sqlite:///runs/mlflow.db or http://host:5000"
        raise InputError("MLflow keeps no runs there", expected=wanted, found=repr(public_url(uri)))
    check_whole("tracking.uri", uri)
    # Which driver a plain postgresql:// means depends on the version of SQLAlchemy.
    uri = re.sub("^postgresql://", "postgresql+psycopg2://", uri)
    if (database := sqlite_file(uri)) is None:
        return uri
    _, question_mark, options = uri.partition("?")
    if question_mark and "=" not in options:
        problem, fix = "? begins the options of a database", "write %3F for one in a path"
        raise InputError(problem, key="tracking.uri", found=repr(uri), fix=fix)
    return sqlite_uri(database.resolve()) + question_mark + options


def sqlite_uri(database: Path) -> str:
    """Write the URI of a SQLite database, quoted as by SQLAlchemy.

    It names the driver, as MLflow makes the folders of a plain `sqlite:///` URI without removing
    the quotes."""
    return f"sqlite+pysqlite:///{quote(str(database), safe=' +/')}"


def sqlite_file(uri: str) -> Path | None:
    """Return the database file of a `sqlite:///` URI, None for other URIs."""
    match = re.match(r"sqlite(?:\+\w+)?:///([^?]+)", uri)
    return Path(unquote(match[1])) if match else None


def is_server(uri: str) -> bool:
    """Tell whether `uri` is a tracking server, not a database."""
    return uri.startswith(("http://", "https://"))


def ui_command(uri: str, page: str = "") -> str:
    """Return the command line that opens the experiments in a browser; of a server its address.

    `page` is below the address. The password of a database is masked, the user has to write it."""
    if is_server(uri):
        return public_url(uri).rstrip("/") + page
    uri = absolute_uri(uri)
    return command("dashboard", str(sqlite_file(uri) or public_url(uri)))
