"""Ctrl-C and SIGTERM at any moment end a command quietly, with the exit code of the signal."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lidarplace.command_line.signals import Terminated, stopped_by_signals
from lidarplace.commands.describe import app as describe
from tests.forked import run_forked

ROOT = Path(__file__).parents[1]
SENDER = """
import os, signal, sys, weakref
from lidarplace.command_line.signals import Terminated, signals_held, stopped_by_signals

def come(*_):
    os.kill(os.getpid(), signal.SIGTERM)

def in_a_weakref_callback():
    with_callback = Held()
    reference = weakref.ref(with_callback, come)
    del with_callback

def in_del():
    Held.__del__ = come
    Held()

def in_a_bare_except():
    try:
        come()
    except:
        pass

class Held:
    pass

def work(*steps):
    try:
        with stopped_by_signals():
            for step in steps:
                step()
    except Terminated:
        sys.exit(143)

def tidy_up():
    try:
        come()
    finally:
        come()
        print("tidies up", flush=True)
        come()
        print("still there")

def in_held_code(then=lambda: None):
    with signals_held():
        come()
        print("begun and ended", flush=True)
        then()
    print("still there")

def in_code_that_hangs():
    in_held_code(come)

def without_alarm():  # it may be late
    signal.setitimer(signal.ITIMER_REAL, 0)

"""
COME = "import os, signal; os.kill(os.getpid(), signal.SIGINT)"


def python(*arguments: str, folder: Path = ROOT) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": f"{folder}:{ROOT}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=as_in_a_terminal,
    )


def as_in_a_terminal() -> None:
    """A shell's background job, such as a test run may be, ignores Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.parametrize(
    ("program", "imported"),
    [
        (("-m", "sweeps.main", "describe", "log"), "numba"),
        (("-m", "sweeps.run"), "typer"),
        (("bin/lidarplace",), "typer"),
    ],
)
def test_ctrl_c_while_a_program_imports_is_quiet(tmp_path, program, imported):
    (tmp_path / f"{imported}.py").write_text(f"{COME}\nprint('still there')")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/lidarplace").write_text("from sweeps.main import main\nmain()")
    with python(*program, folder=tmp_path) as process:
        assert process.communicate() == ("", "")
    assert process.returncode == -signal.SIGINT  # of which a shell makes 130


@pytest.mark.parametrize("program", [("-m", "mine.tool"), ("-c", "import mine.tool")])
def test_who_imports_the_packages_keeps_ctrl_c(tmp_path, program):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/__init__.py").write_text("import sweeps, tracking, lidarplace")
    (tmp_path / "mine/tool.py").write_text(f"try:\n    {COME}\nfinally:\n    print('closed')")
    with python(*program, folder=tmp_path) as process:
        out, err = process.communicate()
    assert out == "closed\n"
    assert "KeyboardInterrupt" in err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_command_says_that_it_was_stopped(monkeypatch, number, code):
    read = "lidarplace.commands.describe.read_box_log"
    monkeypatch.setattr(read, lambda _: os.kill(os.getpid(), number))
    as_in_a_terminal()
    before = signal.getsignal(signal.SIGTERM)
    result = CliRunner().invoke(describe, ["log"])
    assert (result.exit_code, result.stdout, result.stderr) == (code, "", "\nStopped.\n")
    assert signal.getsignal(signal.SIGTERM) == before


def stopped_twice():
    with stopped_by_signals():
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # as a library does
        with stopped_by_signals():
            try:
                os.kill(os.getpid(), signal.SIGTERM)
            finally:
                os.kill(os.getpid(), signal.SIGTERM)


def test_a_second_sigterm_does_not_break_off_what_tidies_up():
    with pytest.raises(Terminated):
        stopped_twice()


@pytest.mark.parametrize(
    ("steps", "code"),
    [
        ("in_a_weakref_callback, signal.pause", 143),
        ("in_del, signal.pause", 143),
        ("in_a_bare_except, signal.pause", 143),
        ("in_a_bare_except, without_alarm, come", -signal.SIGTERM),
    ],
)
def test_a_swallowed_sigterm_comes_again_and_the_next_one_ends_the_process(tmp_path, steps, code):
    assert run_forked(["-c", f"{SENDER}work({steps})"], ROOT, tmp_path).returncode == code


@pytest.mark.parametrize(
    ("work", "expected", "code"),
    [
        ("in_held_code", "begun and ended\n", 143),
        ("in_code_that_hangs", "begun and ended\n", -signal.SIGTERM),
        ("tidy_up", "tidies up\n", -signal.SIGTERM),
    ],
)
def test_native_code_is_not_left_half_way_and_a_third_sigterm_ends_it(
    tmp_path, work, expected, code
):
    result = run_forked(["-c", f"{SENDER}work({work})"], ROOT, tmp_path)
    assert (result.stdout, result.stderr, result.returncode) == (expected, "", code)
