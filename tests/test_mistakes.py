"""Mistakes in settings and in data, and the line that each prints: `tests/data/messages.txt`.

A new case is a line in that file with a line below it; `<<< NAME: TEXT` behind a command writes a
file before it runs; behind `python` stands an expression of tests/mistakes_world.py. This writes
the words of all anew: `NEW_MESSAGES=1 python -m pytest -n 0 tests/test_mistakes.py`.
"""

import json
import os
import re
import shlex
import shutil
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from lidarplace.rigs.catalogue.datasheet import catalogue
from sweeps.command_line import app
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import read_sweep
from sweeps.configuration.point import Point
from sweeps.configuration.sweep import Common
from tests.docs_blocks import ROOT
from tests.mistakes_world import names
from tests.sweeps.search_files import write_search
from tests.sweeps.small_log import write_small_log
from tests.sweeps.test_requirements_command import small
from training.settings import TrainingSettings

GRID, SEARCH = "examples/grid.yaml", "examples/search.yaml"
LABELS = "examples/labels/labels.csv"
MESSAGES = ROOT / "tests/data/messages.txt"
BASE = {"placement": "line", "grid": {"placement": ["line", "center"], "seed": [1, 2]}}


def messages() -> dict[str, str]:
    """Case -> the line, in the only place that has the words of it."""
    lines = MESSAGES.read_text("utf-8").splitlines()
    return dict(zip(lines[::3], lines[1::3], strict=True))


def cases(prefix: str) -> list[str]:
    return [case.removeprefix(prefix) for case in messages() if case.startswith(prefix)]


def check(case: str, line: str) -> None:
    """Compare with the line of the file, or write it there; a long list is cut after one name.

    So a new key or LiDAR changes no line; `test_long_lists_are_complete` has whole lists.
    """
    line = re.sub(r"(expected one of \w+)(?:, (?!found)[\w.]+){4,}", r"\1, …", line)
    lines = messages()
    if "NEW_MESSAGES" in os.environ:
        lines[case] = line
        MESSAGES.write_text("\n\n".join(map("\n".join, lines.items())) + "\n", "utf-8")
    assert lines[case] == line


@pytest.fixture
def world(tmp_path, monkeypatch) -> Path:
    """A folder with the examples and a small log."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    write_small_log(tmp_path / "log")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def line_of(*words: str) -> str:
    """Run a command that prints one line on stderr, with exit code 2."""
    result = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    # Files beside another one are told whole.
    return result.stderr.strip().replace(f"{Path.cwd()}/", "")


@pytest.mark.parametrize("changes", [case for case in messages() if case.startswith("{")])
def test_a_sweep(changes, world):
    (path := world / "grid.yaml").write_text(yaml.safe_dump(BASE | json.loads(changes)))
    with pytest.raises(ConfigError) as error:
        read_sweep(path)
    line = str(error.value).removeprefix(f"{path}: ")
    check(changes, line)
    assert error.value.place == str(path)
    assert line.startswith(f"{error.value.key}: ")


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"x": 1}, [*Point.model_fields, *Common.model_fields, "grid", "exclude"]),
        ({"training": {"x": 1}}, [*TrainingSettings.model_fields]),
        ({"lidar": "x"}, catalogue()),
    ],
)
def test_long_lists_are_complete(changes, names, world):
    (path := world / "grid.yaml").write_text(yaml.safe_dump(BASE | changes))
    with pytest.raises(ConfigError, match=f"; expected one of {', '.join(names)}$"):
        read_sweep(path)


@pytest.mark.parametrize("changes", cases("search "))
def test_a_search(changes, world):
    path = write_search(Path(), **json.loads(changes))
    check(f"search {changes}", line_of("search", str(path)).removeprefix(f"{path}: "))


@pytest.mark.parametrize("changes", cases("requirements "))
def test_requirements(changes, world):
    """`people` are changes of the only requirement."""
    settings = json.loads(changes)
    (world / "needs.yaml").write_text(
        yaml.safe_dump(small(**settings.pop("people", {})) | settings)
    )
    line = line_of("requirements", "needs.yaml")
    check(f"requirements {changes}", line.removeprefix("needs.yaml: "))


@pytest.mark.parametrize("pair", cases("--set "))
def test_settings(pair, world):
    verb, file = ("search", SEARCH) if pair.startswith("search.") else ("run", GRID)
    line = line_of(verb, file, "--dry-run", "--set", pair)
    check(f"--set {pair}", line.removeprefix(f"{file}: "))


@pytest.mark.parametrize("change", cases("map.yaml "))
def test_mappings(change, world):
    mapping = yaml.safe_load((world / "examples/labels/map.yaml").read_text("utf-8"))
    key, value = yaml.safe_load(change).popitem()
    section, _, name = key.rpartition(".")
    (mapping[section] if section else mapping)[name] = value
    (world / "map.yaml").write_text(yaml.safe_dump(mapping))
    line = line_of("convert", "table", LABELS, "out", "--mapping", "map.yaml")
    check(f"map.yaml {change}", line)
    assert not (world / "out").exists()


@pytest.mark.parametrize("case", cases("lidarplace "))
def test_commands(case, world):
    command, *files = case.split(" <<< ")
    for file in files:
        name, text = file.split(": ", 1)
        (world / name).parent.mkdir(exist_ok=True)
        (world / name).write_text(text.replace("\\n", "\n"))
    before = sorted(world.rglob("*"))
    check(f"lidarplace {case}", line_of(*shlex.split(command)))
    assert sorted(world.rglob("*")) == before, "nothing is written"


@pytest.mark.parametrize("call", cases("python "))
def test_python(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the whole line is compared
        eval(call, dict(names()))
    check(f"python {call}", str(error.value))
