"""Runs in folders with names of any characters: finished, and nothing is written elsewhere."""

from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest
from sqlalchemy.engine import make_url
from typer.testing import CliRunner

from sweeps.command_line import app
from tests.fuzz.cases import copied
from tests.fuzz.targets import parts_of
from tracking.mlflow.uri import sqlite_file, sqlite_uri

SEED = 50
CHARACTERS = "?%#&=:;@+,.~!$^*()[]{}<>|'\"`\\ \t\n-_ü名2041Fa"
CASES = [0, *(pytest.param(n, marks=pytest.mark.long) for n in range(1, 20))]
SETS = ("ray=debug", "detector=null", "grid={placement: [line]}", "surrogate.sampling_error=false")


def names(seed: int) -> Iterator[str]:
    random = Random(seed)
    while True:
        name = "".join(random.choices(CHARACTERS, k=random.randint(1, 12)))
        if name.strip("."):
            yield name


def test_addresses_of_databases_are_those_of_sqlalchemy():
    for name, _ in zip(names(SEED), range(2000), strict=False):
        uri = sqlite_uri(Path(f"/{name}/mlflow.db"))
        assert make_url(uri).database == f"/{name}/mlflow.db" == str(sqlite_file(uri))


@pytest.mark.parametrize(
    "case", [0, *(pytest.param(n, marks=pytest.mark.long) for n in range(1, 20))]
)
def test_a_run(world, tmp_path, monkeypatch, case):
    folder = tmp_path / next(names(SEED + case))
    copied(world, folder, parts_of("run sweep.yaml", world))
    monkeypatch.chdir(folder)
    for verb, options in (("run", SETS), ("status", SETS), ("doctor", SETS)):
        line = [verb, "sweep.yaml", *(word for pair in options for word in ("--set", pair))]
        result = CliRunner().invoke(app, line)
        assert result.exit_code == 0, (folder.name, result.output)
    assert [path.name for path in tmp_path.iterdir()] == [folder.name]
    assert Path("runs/sweep/report.html").is_file()
