"""Names reach the terminal as they are: as no style, no picture, no order to the terminal."""

import ast
import io
import sys
from pathlib import Path

import pytest
import typer
from rich.table import Table

from lidarplace.command_line.terminal import Terminal, output, say, table, visible
from lidarplace.command_line.verbs import wrong
from sweeps.execution.failures import Failure
from sweeps.execution.progress import StageProgress
from sweeps.stages.task import Task
from sweeps.store.local import Store
from tests.sweeps.toy import TrainingToy

ROOT = Path(__file__).parents[2]
NAMES = ["a[/x]", "roof[left]", "[bold]b[/bold]", ":smile:", r"c\[d]", "[/]"]
OBEYED = "up\x1b[2A\x1b]0;title\x07\x9b1m\rover\x7f"


def printed(print_to, *arguments, terminal=False):
    """What is printed on a wide console, without the colours of our own."""
    file = io.StringIO()
    console = Terminal(file=file, width=400, force_terminal=terminal, color_system=None)
    print_to(console, *arguments)
    return file.getvalue()


def assert_shown(text):
    for name in NAMES:
        assert name in text
    assert not set(text) & set("\x07\x9b\r\x7f")
    assert "\x1b[2A" not in text
    assert r"up\x1b[2A" in text


def test_only_what_a_terminal_obeys_is_written_out():
    assert visible("é ✓ 中 a\tb\nc – [x] \\") == "é ✓ 中 a\tb\nc – [x] \\"
    assert visible("\x1b\x00\x7f\x9b\r\u202e\udce9") == r"\x1b\x00\x7f\x9b\x0d\u202e\udce9"


def test_lines_cells_heads_and_titles():
    table = Table(OBEYED, title=OBEYED)
    for name in NAMES:
        table.add_row(name)
    assert_shown(printed(lambda console: console.print(table, *NAMES, OBEYED)))


def test_a_row_of_a_file_is_a_line_with_all_its_names(capsys):
    head = ["placement", *(f"covered_entropy.class_{i}" for i in range(40))]
    rows = [[f"rig_{'with_a_long_name' * 20}_{i}", *range(i, 40 + i)] for i in range(3)]
    output().print(table("title", head, rows), "a line " * 100)
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines == [["title"], head, *([str(cell) for cell in row] for row in rows), lines[-1]]
    assert len(lines[-1]) == 200


def test_plain_lines(capsys):
    say("\n".join([*NAMES, OBEYED, "\udce9"]))
    assert_shown(capsys.readouterr().out)
    with pytest.raises(typer.Exit) as exit_:
        wrong(f"{' '.join(NAMES)} {OBEYED}")
    assert exit_.value.exit_code == 2
    assert_shown(capsys.readouterr().err.replace("\n", ""))


def test_a_line_is_not_longer_than_somebody_reads(capsys):
    with pytest.raises(typer.Exit):
        wrong(f"first {'x' * 10**6} last")
    line = capsys.readouterr().err
    assert len(line) < 3000
    assert line.startswith("first x")
    assert line.endswith("x last\n")


def test_an_option_that_is_unknown(capsys, monkeypatch):
    from sweeps.commands.status import app

    monkeypatch.setattr(sys, "argv", ["status", f"--{OBEYED}"])
    with pytest.raises(SystemExit) as exit_:
        app()
    assert exit_.value.code == 2
    told = capsys.readouterr().err
    assert not set(told) & set("\x07\x1b\x9b\r\x7f")
    assert r"up\x1b[2A" in told


@pytest.mark.parametrize("terminal", [False, True])
def test_the_progress_of_a_sweep(terminal, tmp_path):
    store = Store(tmp_path)
    tasks = [Task(TrainingToy(), name) for name in [*NAMES, OBEYED]]

    def run(console):
        with StageProgress(console, tasks, store) as progress:
            for task in tasks:
                progress.started(task)
            progress._bars.refresh()
            for task in tasks:
                progress.failed(task, Failure(f"{task.label} has no points"))

    assert_shown("".join(c for c in printed(run, terminal=terminal) if c != "\r"))


def test_there_is_no_other_console():
    others = []
    for package in ("lidarplace", "training", "tracking", "sweeps"):
        for file in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Console":
                    others.append(file.relative_to(ROOT).as_posix())
    assert not others
