"""Names for the cases of Python in `tests/data/messages.txt` and tiny data for them."""

import gzip  # noqa: F401 - for cases
import json
import math
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace  # noqa: F401 - for cases
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd

import lidarplace
from tests.lidarplace.argoverse_layout import LEVEL, Log, write_argoverse
from tests.lidarplace.argoverse_layout import Box as ArgoverseBox
from tests.lidarplace.nuscenes_layout import Box, Sample, Scene, write_nuscenes
from tests.lidarplace.test_plotting import LINE, ROI, boxes  # noqa: F401 - for cases
from tests.lidarplace.waymo_layout import Box as WaymoBox
from tests.lidarplace.waymo_layout import Segment, write_waymo
from tests.sweeps.small_log import write_small_log
from tests.tracking.made_up_run import write_run
from tests.tracking.made_up_search import write_search

MODULES = """
lidarplace.base.ranges lidarplace.clouds.cloud_files lidarplace.clouds.clouds
lidarplace.clouds.collect lidarplace.clouds.recorded lidarplace.configuration.correction
lidarplace.configuration.further_sensors lidarplace.configuration.yaml lidarplace.detections.read
lidarplace.logs.box_log lidarplace.mounting.errors lidarplace.mounting.mesh
lidarplace.mounting.polygon lidarplace.mounting.vehicle
lidarplace.mounting.zone lidarplace.pog.occupancy.entropy
lidarplace.pog.surrogates.error_against_time lidarplace.pog.surrogates.evaluate
lidarplace.pog.surrogates.formulas lidarplace.pog.surrogates.sampling_error
lidarplace.recall.detection_curve lidarplace.requirements.area lidarplace.requirements.layout
lidarplace.requirements.presets.read lidarplace.requirements.requirement
lidarplace.rig_files.formats lidarplace.rigs.recorded lidarplace.rigs.scan_pattern
lidarplace.rigs.weather lidarplace.scenes.datasets.argoverse lidarplace.scenes.datasets.nuscenes
lidarplace.scenes.datasets.openlabel lidarplace.scenes.datasets.tabular
lidarplace.scenes.datasets.waymo lidarplace.scenes.kitti.read
lidarplace.scenes.kitti.velodyne lidarplace.scenes.sumo.record lidarplace.scenes.sumo.settings
lidarplace.studio.rigs_file tests.lidarplace.test_detections
tests.test_own_detector tracking.run_folders.search tracking.run_folders.sweep
tracking.run_folders.sweep_json tracking.run_folders.sweep_tables
tracking.findings.best_placement tracking.statistics.power training training.detectors.contract
training.ops.sparse_conv training.typical_objects
"""
TESTS = """
tests.lidarplace.company_table tests.lidarplace.selection.test_exposure
tests.lidarplace.studio.rigs tests.lidarplace.test_kitti_read tests.lidarplace.test_real_clouds
tests.lidarplace.test_recorded tests.lidarplace.test_sensors_fit tests.lidarplace.test_static_world
"""
"""Modules of tests, of which cases say the name before each of theirs."""
CAR = {"frame": 3, "class": "Car", "x": 9.0, "y": 1.0, "z": 0.8} | {
    "length": 4.5, "width": 1.8, "height": 1.6, "yaw": 0.1
}  # fmt: skip


def file(name: str | Path, content: str | bytes) -> Path:
    """Write it into the current folder."""
    (path := Path(name)).write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def changed(folder: Path, name: str, /, **values: object) -> Path:
    """The folder, with other columns of a table (`...`: without it), keys of JSON, or arrays."""
    path = folder / name
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            np.savez(path, **dict(arrays) | values)
    elif path.suffix == ".json":
        content = json.loads(path.read_text())
        listed = isinstance(content, list)
        content = [content[0] | values, *content[1:]] if listed else content | values
        path.write_text(json.dumps(content))
    else:
        table = pd.read_parquet(path)
        for key, value in values.items():
            name = next((n for n in table if n == key or n.endswith(f".{key}")), key)
            table = (
                table.drop(columns=name)
                if value is ...
                else table.assign(**{name: [value] * len(table)})
            )
        table.to_parquet(path)
    return folder


def written(folder: Path, name: str, content: str | bytes | None) -> Path:
    """The folder, with other content of a file, or without the file."""
    (folder / name).unlink() if content is None else file(folder / name, content)
    return folder


def csv(**columns: object) -> Path:
    """A table of one's own with two cars."""
    (path := Path("boxes.csv")).write_text(
        pd.DataFrame([CAR, CAR]).assign(**columns).to_csv(index=False)
    )
    return path


def folder_of_csv(**columns: object) -> Path:
    """Folder of `csv` and a table of frames with these columns; None: without the column."""
    frames = {"scene": ["a", "a", "b"], "frame": [3, 4, 5], "timestamp_s": 0.0, "split": "train"}
    csv(scene="a")
    table = pd.DataFrame(frames | columns)
    table.drop(columns=[name for name in columns if columns[name] is None]).to_csv(
        "frames.csv", index=False
    )
    return Path()


def small_log() -> Path:
    write_small_log(Path("log"))
    return Path("log")


def run_folder() -> Path:
    return Path(shutil.copytree(_made_up(), "run"))


@cache
def _made_up() -> Path:
    return write_run(Path(tempfile.mkdtemp()) / "run")


def search_folder() -> Path:
    return write_search(Path("found"), trials=10, complete=False)


def detected(**columns: object) -> Path:
    """A table of two detections."""
    pd.DataFrame(names()["GOOD"] | columns).to_parquet("found.parquet")
    return Path("found.parquet")


def nuscenes() -> Path:
    car = Box("vehicle.car", (9.0, 0.0, 1.0))
    scenes = [Scene("scene-0001", [Sample(5, [car])])]
    return write_nuscenes(Path("v1.0-mini"), scenes, ["vehicle.car"])


def argoverse(category: str | None = "BUS", **values: object) -> Path:
    """A log with a car, and a box of these values."""
    box = {"timestamp_ns": 5, "category": "BUS", "translation": (9.0, 0.0, 1.0)}
    two = [ArgoverseBox(**box), ArgoverseBox(**box | {"category": category} | values)]
    log = Log("train", "a", two, {5: (LEVEL, (0.0, 0.0, 0.0))}, [5])
    return write_argoverse(Path("av2"), [log])


def waymo() -> Path:
    box = WaymoBox(5, 1, (9.0, 0.0, 1.0))
    return write_waymo(Path("waymo"), [Segment("training", "s", {5: np.eye(4)}, [box])])


def openlabel(where: str = "kiosk", value: object = None) -> Path:
    """A drive that is wrong at a place; None: that is not there."""
    drive = json.loads((Path(__file__).parent / "data/openlabel/drive.json").read_text())
    *parents, last = where.split("/")
    at = drive["openlabel"]
    for key in parents:
        at = at[int(key) if isinstance(at, list) else key]
    if value is None:
        at.pop(last, None)
    else:
        at[int(last) if isinstance(at, list) else last] = value
    return file("drive.json", json.dumps(drive))


def curves(*changes: dict[str, object]) -> str:
    """A file of detection curves."""
    curve = {"class": "Car", "iou": 0.5, "most": 0.9, "rate": 0.07}
    every = [curve | change for change in changes]
    return json.dumps({"command": "", "cell": 0.2, "curves": every})


@cache
def names() -> Mapping[str, object]:
    """All names that cases may use."""
    modules = map(import_module, MODULES.split())
    content = {name: value for module in modules for name, value in vars(module).items()}
    content |= {name: getattr(lidarplace, name) for name in lidarplace.__all__} | vars(math)
    content |= {name.rpartition(".")[2]: import_module(name) for name in TESTS.split()}
    return content | {"np": np, "pd": pd, "Path": Path} | globals()
