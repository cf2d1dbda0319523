"""A tracking server that is away at the start, killed in the middle, and started again."""

from __future__ import annotations

import os
import signal

import pytest
from mlflow_runs_of import (
    assert_logged_once,
    free_port,
    log_trial,
    new_store,
    runs_of,
    start_server,
    until,
)

from tracking.mlflow.journal import Journal, TrialEntry
from tracking.mlflow.log import SweepLog

MORE = range(3, 12)


def kill(server):
    os.killpg(server.pid, signal.SIGKILL)
    server.wait(60)


def test_a_server_comes_and_goes_and_gets_everything_once(tmp_path):
    uri = new_store(tmp_path / "store")
    port = free_port()
    address = f"http://me:s3cret@127.0.0.1:{port}"
    journal = tmp_path / "demo" / "mlflow.jsonl"
    report = tmp_path / "report.html"
    report.write_text("<p>report</p>")
    said: list[str] = []

    def log(patience_s=60.0):
        return SweepLog(
            address, "demo", "k1", {"x": 1}, journal=journal, say=said.append, patience_s=patience_s
        )

    # Away at the start and never back: the journal keeps all.
    for patience_s in (0.3, 0.0):
        with log(patience_s) as away:
            log_trial(away, 1)
            log_trial(away, 2)
            away.artifact(report)
    assert sum(isinstance(entry, TrialEntry) for entry in Journal(journal).entries) == 2
    assert len(said) == 4
    assert said[0].startswith(f"MLflow at http://me:***@127.0.0.1:{port} is away, the sweep goes")
    assert "s3cret" not in "".join(said) + journal.read_text()
    assert said[1] == f"MLflow: 5 entries wait in {journal}; the same command delivers them"
    said.clear()

    # There, killed in the middle, started again.
    server = start_server(uri, port, tmp_path)
    try:
        with log() as interrupted:
            for seed in MORE:
                log_trial(interrupted, seed)
            until(lambda: interrupted.undelivered <= len(MORE) - 5)
            kill(server)
            until(lambda: bool(said))
            assert interrupted.undelivered
            server = start_server(uri, port, tmp_path)
        assert (interrupted.undelivered, interrupted.refused) == (0, 0)
        assert [line.split(" is ")[1].split(",")[0] for line in said] == ["away", "back"]
        assert not journal.exists()
        assert_logged_once(address, range(1, MORE.stop))
        assert len(list((tmp_path / "artifacts").rglob("report.html"))) == 1

        # A request and a file that the server does not take, and a sweep that it does not take.
        (tmp_path / "artifacts").rename(tmp_path / "moved")
        (tmp_path / "artifacts").write_text("a file where a folder should be")
        with log() as refused:
            refused.artifact(report)
            refused.trial("bad", "bad", {}, {"no such\nname": 1.0})
            log_trial(refused, MORE.stop)
        assert (refused.undelivered, refused.refused) == (0, 2)
        assert runs_of(address)[f"line · tiny · seed {MORE.stop}"].info.status == "FINISHED"
        with (
            pytest.raises(ValueError, match="has x = 1, now it is 2"),
            SweepLog(address, "demo", "k1", {"x": 2}, journal=journal),
        ):
            pass
    finally:
        kill(server)
