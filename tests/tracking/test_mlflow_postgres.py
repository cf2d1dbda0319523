"""PostgreSQL as MLflow's database, written by the driver itself."""

import os
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest

from tests.forked import free_port
from tests.tracking.mlflow_runs_of import assert_logged_once, logged, logging, trial_of, until
from tracking.mlflow.uri import absolute_uri

PASSWORD = "s3c@ret"
# The server refuses to run as root.
ACCOUNT = "nobody" if os.getuid() == 0 else None


class Postgres:
    """A PostgreSQL server on this machine, in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.port = free_port()
        self.uri = f"postgresql://postgres:s3c%40ret@127.0.0.1:{self.port}/postgres"
        folder.chmod(0o755)
        (folder / "password").write_text(PASSWORD)
        (folder / "data").mkdir(mode=0o700)
        if ACCOUNT:
            shutil.chown(folder / "data", ACCOUNT)
        options = ("-U", "postgres", "-A", "scram-sha-256", "--pwfile", "password")
        self._run("initdb", "-D", "data", *options).wait(120)
        self.start()

    def start(self) -> None:
        self._server = self._run(
            *("postgres", "-D", "data", "-p", str(self.port)),
            *("-c", "listen_addresses=127.0.0.1", "-c", "unix_socket_directories="),
        )
        until(self._ready)

    def kill(self) -> None:
        """End the server at once, as a power cut would."""
        self._server.send_signal(signal.SIGQUIT)
        self._server.wait(60)

    def _ready(self) -> bool:
        import psycopg2

        try:
            psycopg2.connect(self.uri).close()
        except psycopg2.OperationalError:
            assert self._server.poll() is None, (self.folder / "log").read_text()
            return False
        return True

    def _run(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        path = shutil.which(program)
        assert path is not None
        with (self.folder / "log").open("ab") as log:
            process_options = {"cwd": self.folder, "user": ACCOUNT, "stdout": log, "stderr": log}
            return subprocess.Popen([path, *arguments], **process_options)


@pytest.fixture(scope="module")
def postgres():
    pytest.importorskip("psycopg2", reason="psycopg2: pip install 'lidarplace[postgres]'")
    for program in ("initdb", "postgres"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not in PATH: install PostgreSQL's server")
    # Not in pytest's folder, which other accounts cannot enter.
    with tempfile.TemporaryDirectory() as folder:
        server = Postgres(Path(folder))
        yield server
        server.kill()


def test_a_database_that_is_killed_gets_everything_once(postgres, tmp_path):
    (report := tmp_path / "report.html").write_text("<p>report</p>")
    messages: list[str] = []

    def log(seeds, patience_s=60.0):
        keys = {"say": messages.append, "patience_s": patience_s}
        with logging(postgres.uri, tmp_path / "demo", [*map(trial_of, seeds)], **keys) as log:
            if 4 in seeds:
                until(lambda: log.undelivered <= len(seeds) - 4)
                postgres.kill()
                until(lambda: bool(messages))
                postgres.start()
                log.artifact(report)
        return log.undelivered

    assert log(range(1, 3)) == 0
    assert messages == []
    assert log(range(1, 12)) == 0
    assert [line.split(" is ")[1].split(",")[0] for line in messages] == ["unreachable", "back"]
    postgres.kill()
    assert log([12], patience_s=0.2) == 2
    postgres.start()
    assert log([12, 13]) == 0
    assert_logged_once(absolute_uri(postgres.uri), range(1, 14))
    assert len(list((tmp_path / "demo" / "artifacts").rglob("report.html"))) == 1
    assert PASSWORD not in "".join(messages)
    assert "s3c%40ret" not in "".join(messages)


def test_a_wrong_password_is_an_error_without_it(postgres, tmp_path):
    uri = postgres.uri.replace("s3c%40ret", "other")
    messages: list[str] = []
    logged(uri, tmp_path, key="k3", say=messages.append, patience_s=0.1)
    assert "password authentication failed" in messages[0]
    assert "other@" not in messages[0]
