"""What the dashboard starts ends with it, however it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from tracking.mlflow.ends_with_parent import ending_with_parent

ROOT = Path(__file__).parents[2]
# Starts a process in turn, as MLflow's server does.
SERVER = """
import subprocess, sys, time
inner = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print(inner.pid, flush=True)
time.sleep(600)
"""
PARENT = f"""
import subprocess, sys, time
from tracking.mlflow.ends_with_parent import ending_with_parent
command = ending_with_parent([sys.executable, "-c", {SERVER!r}])
subprocess.Popen(command, stdin=subprocess.PIPE)
time.sleep(600)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_all_that_was_started_ends_with_a_parent_that_is_killed(how):
    with subprocess.Popen(
        [sys.executable, "-c", PARENT],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        inner = int(parent.stdout.readline())
        below = psutil.Process(parent.pid).children(recursive=True)
        assert inner in [process.pid for process in below]
        assert len(below) == 3
        os.kill(parent.pid, how)
        _, alive = psutil.wait_procs(below, timeout=120)
        assert not alive


@pytest.mark.parametrize("code", [0, 3])
def test_the_exit_code_is_that_of_the_command(code):
    command = [sys.executable, "-c", f"raise SystemExit({code})"]
    with subprocess.Popen(
        ending_with_parent(command),
        cwd=ROOT,
        stdin=subprocess.PIPE,
    ) as process:
        assert process.wait(timeout=120) == code
