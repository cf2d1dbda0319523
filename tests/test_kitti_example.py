"""examples/kitti.py, from a small folder in KITTI's layout to a decision."""

import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace import OccupancyGrid, Roi, evaluate
from lidarplace.commands.export import app
from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.placement import PAPER_PLACEMENTS
from tests.forked import run_forked
from tests.sweeps.toy import call

ROOT = Path(__file__).parents[1]


def run(folder: Path) -> subprocess.CompletedProcess[str]:
    script = str(ROOT / "examples/kitti.py")
    code = f"import runpy; runpy.run_path({script!r}, run_name='__main__')"
    return run_forked(["-c", code, "kitti"], folder, folder)


def export(folder: Path, object_class: str) -> None:
    """Six frames with two objects each, as KITTI would label them."""
    random = np.random.default_rng(5)
    rows = [
        ("a", frame, k, object_class, 12 + 9 * k, random.uniform(-4, 4), 0.8, 4.4, 1.8, 1.6, 0.1)
        for frame in range(6)
        for k in range(2)
    ]
    boxes = pd.DataFrame(rows, columns=["scene", "frame", "object_id", "class", *GEOMETRY])
    boxes.insert(2, "timestamp_s", boxes["frame"] / 10)
    frames = pd.DataFrame({"scene": "a", "frame": range(6), "route": 0, "split": "train"})
    frames.insert(2, "timestamp_s", frames["frame"] / 10)
    write_box_log(folder / "log", BoxLog(boxes, frames))
    command = [str(folder / "log"), str(folder / "kitti"), "--placement", "line"]
    call(app, *command)


def test_from_labels_to_a_decision(tmp_path):
    export(tmp_path, "Car")
    result = run(tmp_path)
    assert result.returncode == 0, result.stderr
    log = read_box_log(tmp_path / "logs/kitti")
    assert len(log.frames) == 6
    assert len(log.boxes) == 12
    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.2)
    grid = OccupancyGrid.from_boxes(log.boxes, roi, object_class="Car", frames=6)
    lines = {line.split()[0]: line.split() for line in result.stdout.splitlines() if line.strip()}
    for name in ("line", "center", "pyramid"):
        covered = evaluate(grid, PAPER_PLACEMENTS[name]).covered_entropy
        assert float(lines[name][2]) == pytest.approx(covered, abs=0.06)
    assert "covered_entropy:" in result.stdout
    assert result.stdout.splitlines()[-1].startswith(("all three: ", "they disagree"))
    assert "share of the POG" in (tmp_path / "kitti.html").read_text(encoding="utf-8")


def test_no_car_is_told(tmp_path):
    export(tmp_path, "Pedestrian")
    result = run(tmp_path)
    assert result.returncode == 1
    assert "no car within" in result.stderr
    assert "Traceback" not in result.stderr
