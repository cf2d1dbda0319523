"""A small problem for tests of the search."""

import copy
from pathlib import Path

import yaml
from typer.testing import CliRunner

from lidarplace.logs.box_log import BoxLog, read_box_log
from sweeps.commands.search import app
from tests.mlflow_database import write_database
from tests.sweeps.small_log import write_small_log
from tracking.run_folders.search import SearchFolder

ROOF = {"x": [-0.5, 0.5], "y": [-0.6, 0.6], "z": [1.8, 2.2]}
SEARCH = {"classes": ["Car"], "lidar": {"beams": 4, "azimuth_steps": 90}, "ray": "debug"}
SEARCH |= {"surrogate": {"resolution": 0.8}, "robustness": {"draws": 3}}
SEARCH["search"] = {"lidars": 2, "zones": {"roof": ROOF}, "roll_deg": [-10, 10], "trials": 12}
SEARCH["search"] |= {"objective": "expected_ig", "azimuth_stride": 1, "batch_size": 4}
SEARCH["search"] |= {"greedy": {"position_step": 0.5, "bound_seconds": 2.0}}


def write_search(folder: Path, **changes) -> Path:
    """A configuration on a small log; `search` is merged, other keys are replaced."""
    if not (folder / "log").exists():
        write_small_log(folder / "log")
    config = copy.deepcopy(SEARCH)
    search = changes.pop("search", {})
    config["search"] |= search
    for zone in config["search"]["zones"].values():
        zone.setdefault("standoff", None)  # what these tests are of is mounted anywhere
    if "lidars" not in search and any("lidars" in z for z in config["search"]["zones"].values()):
        del config["search"]["lidars"]
    config |= {"scene": {"source": "log", "folder": str(folder / "log")}}
    config |= {"output": str(folder / "runs")} | changes
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(config))
    return path


def run_search(path: Path, *options: str, codes: tuple[int, ...] = (0,)) -> str:
    """What the command prints about a configuration of `write_search`."""
    database = path.parent / "runs/mlflow.db"
    if path.name == "small.yaml" and not database.exists():
        write_database(database)
    result = CliRunner().invoke(app, [str(path), *options], catch_exceptions=False)
    assert result.exit_code in codes, result.output
    return result.output


def train_log(folder: Path) -> BoxLog:
    """The frames to train on of the log in a folder."""
    log = read_box_log(folder)
    frames = log.frames[log.frames["split"] == "train"]
    return BoxLog(log.boxes[log.boxes["frame"].isin(frames["frame"])], frames, log.buildings)


def searched(folder: Path, code: int = 0, **changes) -> tuple[SearchFolder, str]:
    """The run folder of a search, and what it printed."""
    path = write_search(folder, **changes)
    output = run_search(path, codes=(code,))
    return SearchFolder.read(folder / "runs" / changes.get("name", "small")), output
