"""`lidarplace accuracy`: what it writes, and one line for a mistake."""

import numpy as np
import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner

from lidarplace.logs.box_log import BoxLog, write_box_log
from sweeps.commands.accuracy import app

FRAMES = 12


def box_log():
    rng = np.random.default_rng(0)
    frame = np.arange(FRAMES)
    boxes = pd.DataFrame(
        {
            "scene": "town",
            "frame": frame,
            "timestamp_s": 0.1 * frame,
            "object_id": "car",
            "class": "Car",
            "x": rng.uniform(2, 7, FRAMES),
            "y": rng.uniform(-3, 3, FRAMES),
            "z": 0.8,
            "length": 4.0,
            "width": 1.8,
            "height": 1.6,
            "yaw": 0.2,
        }
    )
    frames = boxes[["scene", "frame", "timestamp_s"]].assign(route="a", split="train")
    return boxes.iloc[2:], frames


@pytest.fixture
def files(tmp_path):
    boxes, frames = box_log()
    write_box_log(tmp_path / "log", BoxLog(boxes, frames))
    boxes.to_csv(tmp_path / "boxes.csv", index=False)
    config = {
        "scene": {"density": 10},
        "roi": {"x": [0, 8], "y": [-4, 4], "z": [0, 2]},
        "lidar": {"beams": 4, "azimuth_steps": 360},
        "grid": {"placement": ["line", "center", "square"]},
    }
    (tmp_path / "grid.yaml").write_text(yaml.safe_dump(config))
    return tmp_path


def run(files, *arguments):
    options = ("--config", files / "grid.yaml", "--out", files / "out" / "found")
    return CliRunner().invoke(app, [str(a) for a in (*arguments, *options)])


@pytest.mark.parametrize("log", ["log", "boxes.csv --frames 12"])
def test_tables_and_figure_are_written(files, log):
    path, *options = log.split()
    steps = ("--resolution", 0.4, "--resolution", 0.2, "--azimuth-steps", 90)
    done = run(files, files / path, *options, *steps)
    assert done.exit_code == 0, done.output
    assert "Rank agreement with the reference and errors · Car" in done.output
    table = pd.read_parquet(files / "out" / "found.parquet")
    assert set(table["placement"]) == {"line", "center", "square"}
    assert set(table["resolution"]) == {0.4, 0.2}
    assert set(table["method"]) == {"cone", "dda", "bresenham"}
    exact = table[(table["method"] == "cone") & (table["frames"] == FRAMES)]
    assert (exact["method_error"] == 0).all()
    assert (table.loc[table["method"] == "dda", "method_error"] > 0).any()
    assert len(pd.read_csv(files / "out" / "found.csv")) == len(table)
    page = (files / "out" / "found.html").read_text()
    assert "Error against run time" in page
    assert not list((files / "out").glob("*.part"))
