"""Commands that run beside the studio."""

import signal
import threading

import pytest

from lidarplace.studio.page.asking import LINES, NICENESS, Command

TALK = """
import os, sys
for number in range(int(sys.argv[1])):
    print("line", number)
print("niceness", os.nice(0), file=sys.stderr)
sys.exit(int(sys.argv[2]))
"""
WAIT = """
import signal, sys
def end(*_):
    print("ended by a signal")
    sys.exit(143)
signal.signal(signal.SIGTERM, end)
print("waits", flush=True)
signal.pause()
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Modules that `python -m` finds in its folder."""
    (tmp_path / "talk.py").write_text(TALK)
    (tmp_path / "wait.py").write_text(WAIT)
    monkeypatch.chdir(tmp_path)


def test_a_command_tells_what_it_prints_and_how_it_has_ended(here):
    told = []
    command = Command(["talk", "20", "3"], lambda own: told.append(own.exit_code))
    assert command.wait() == 3
    assert len(command.lines) == LINES
    assert command.lines[0] == f"line {20 - LINES + 1}"
    assert command.lines[-1] == f"niceness {NICENESS}"
    assert len(told) == 22  # after each line, and at the end
    assert told[-1] == 3


def test_a_command_is_cancelled_as_slurm_would(here):
    begun = threading.Event()
    command = Command(["wait"], lambda _: begun.set())
    assert begun.wait(1800)
    assert command.exit_code is None
    command.cancel()
    assert command.wait() == 128 + signal.SIGTERM
    assert command.lines == ("waits", "ended by a signal")
    command.cancel()  # once more does no harm
