"""A tracking server that is away at the start, killed in the middle, and started again."""

import pytest

from tests.forked import free_port
from tests.tracking import mlflow_runs_of as made

MORE = range(3, 12)


def kill(server):
    server.kill()
    server.wait(60)


def test_a_server_comes_and_goes_and_gets_everything_once(tmp_path):
    uri = made.new_store(tmp_path / "store")
    port = free_port()
    address = f"http://me:s3cret@127.0.0.1:{port}"
    (report := tmp_path / "report.html").write_text("<p>report</p>")
    lines: list[str] = []

    def log(seeds, patience_s=60.0, params=None):
        ended = map(made.trial_of, seeds) if isinstance(seeds, range) else seeds
        keys = {"params": params or {"x": 1}, "say": lines.append, "patience_s": patience_s}
        return made.logging(address, tmp_path / "demo", [*ended], **keys)

    # Away at the start and never back.
    for patience_s in (0.3, 0.0):
        with log(range(1, 3), patience_s) as away:
            away.artifact(report)
    assert len(lines) == 4
    assert lines[0].startswith(
        f"MLflow at http://me:***@127.0.0.1:{port} is unreachable, the sweep"
    )
    assert "s3cret" not in "".join(lines)
    assert lines[1].startswith("MLflow has not got 4 runs or files; the same command")
    lines.clear()

    # There, killed in the middle, started again.
    server = made.start_server(uri, port, tmp_path)
    try:
        with log(range(1, MORE.stop)) as interrupted:
            interrupted.artifact(report)
            made.until(lambda: interrupted.undelivered <= len(MORE) - 5)
            kill(server)
            made.until(lambda: bool(lines))
            assert interrupted.undelivered
            server = made.start_server(uri, port, tmp_path)
        assert (interrupted.undelivered, interrupted.refused) == (0, 0)
        assert [line.split(" is ")[1].split(",")[0] for line in lines] == ["unreachable", "back"]
        made.assert_logged_once(address, range(1, MORE.stop))
        assert len(list((tmp_path / "artifacts").rglob("report.html"))) == 1

        # A request that the server does not take, and a sweep that it does not take.
        bad = made.trial("bad", metrics={"no such\nname": 1.0})
        with log([bad, made.trial("drawn", files=[report]), made.trial_of(MORE.stop)]) as refused:
            refused.artifact(report)
        assert (refused.undelivered, refused.refused) == (0, 1)
        runs = made.runs_of(address)
        for name in ("drawn", f"line · tiny · seed {MORE.stop}"):
            assert runs[name].info.status == "FINISHED"
        assert "s3cret" not in str([run.data.tags for run in runs.values()])
        with pytest.raises(ValueError, match="expected 1, found 2"), log([], params={"x": 2}):
            pass
    finally:
        kill(server)
