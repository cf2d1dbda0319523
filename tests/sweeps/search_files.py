"""A small problem for tests of the search."""

import copy
from pathlib import Path

import yaml

from tests.sweeps.small_log import write_small_log

SEARCH = {
    "classes": ["Car"],
    "lidar": {"beams": 4, "azimuth_steps": 90},
    "surrogate": {"resolution": 0.8},
    "ray": "debug",
    "search": {
        "lidars": 2,
        "zones": {"roof": {"x": [-0.5, 0.5], "y": [-0.6, 0.6], "z": [1.8, 2.2]}},
        "roll_deg": [-10, 10],
        "objective": "expected_ig",
        "azimuth_stride": 1,
        "trials": 12,
        "batch_size": 4,
        "greedy": {"position_step": 0.5, "bound_seconds": 2.0},
    },
    "robustness": {"draws": 3},
}


def write_search(folder: Path, **changes) -> Path:
    """A configuration on a small log; `search` is merged, other keys are replaced."""
    if not (folder / "log").exists():
        write_small_log(folder / "log")
    config = copy.deepcopy(SEARCH)
    config["search"] |= changes.pop("search", {})
    for zone in config["search"]["zones"].values():
        zone.setdefault("standoff", None)  # what these tests are of is mounted anywhere
    if any("lidars" in zone for zone in config["search"]["zones"].values()):
        del config["search"]["lidars"]
    config |= {"scene": {"source": "log", "folder": str(folder / "log")}}
    config |= {"output": str(folder / "runs")} | changes
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(config))
    return path
