"""Everything that reads input: verbs with their command lines, and readers that no verb reaches."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tests.fuzz.world import CROP, FRAMES


@dataclass(frozen=True)
class Target:
    """Something that reads files of the world.

    Attributes:
        name: for the table of counts; `verb` and what it reads.
        module: of the verb, "" for a reader.
        arguments: of its command line, relative to the world.
        read: the reader, given the world.
        files: what is made wrong, patterns in the world.
        needs: what is copied beside it.
        codes: exit codes that say no mistake of the input.
        check: of what was done; returns what is nonsense in it.
    """

    name: str
    files: tuple[str, ...]
    module: str = ""
    arguments: tuple[str, ...] = ()
    read: Callable[[Path], object] | None = None
    needs: tuple[str, ...] = ()
    codes: tuple[int, ...] = (0,)
    check: Callable[[Path], str] = field(default=lambda world: "")

    def app(self) -> Any:
        """Of the verb."""
        return import_module(self.module).app


def _nonsense(name: str, world: Path) -> str:
    """What no box log may hold, looked for without the reader; "" if there is nothing."""
    boxes = pd.read_parquet(world / name / "boxes.parquet")
    frames = pd.read_parquet(world / name / "frames.parquet")
    possible = [re.fullmatch(r"\w[\w.-]{0,63}", str(name)) for name in set(boxes["class"])]
    if not all(possible) or set(boxes["class"]) & {"all", "ignore"}:
        return f"classes {set(boxes['class'])}"
    geometry = boxes[["x", "y", "z", "length", "width", "height", "yaw"]].to_numpy(float)
    if not np.isfinite(geometry).all() or (geometry[:, 3:6] < 0).any():
        return "sizes and places"
    if not set(frames["split"]) <= {"train", "test"}:
        return f"splits {set(frames['split'])}"
    numbers = frames["frame"]
    if numbers.dtype.kind not in "iu" or (len(numbers) and numbers.abs().max() >= 2**53):
        return f"frame numbers {numbers.dtype}, {numbers.max()}"
    if not set(boxes["frame"]) <= set(numbers) or numbers.duplicated().any():
        return "frames"
    return ""


def _box_log(world: Path) -> object:
    from lidarplace.logs.box_log import read_box_log

    return read_box_log(world / "log")


def _kitti_clouds(world: Path) -> object:
    from lidarplace.scenes.kitti.velodyne import read_kitti_clouds

    return list(read_kitti_clouds(world / "kitti", [0, 1, 2], CROP))


def _recorded(world: Path) -> object:
    from lidarplace.clouds.recorded import clouds_digest, recorded_clouds

    clouds_digest(world / "clouds")
    return list(recorded_clouds(world / "clouds", FRAMES, (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)))


def _rig(world: Path) -> object:
    from lidarplace.clouds.recorded import check_rig
    from lidarplace.rigs.placement import PAPER_PLACEMENTS

    return check_rig(world / "clouds", PAPER_PLACEMENTS["line"])


def _checkpoint(world: Path) -> object:
    from training import build_detector
    from training.checkpoints import load_checkpoint

    return load_checkpoint(build_detector("pointpillars_tiny", ["Car"]), world / "base.pt")


def _run_folder(world: Path) -> object:
    from tracking.run_folders.sweep import RunFolder

    return RunFolder.read(world / "run")


def _search_folder(world: Path) -> object:
    from tracking.run_folders.search import SearchFolder

    return SearchFolder.read(world / "found")


def _failures(world: Path) -> object:
    from sweeps.execution.failures import FailureFolder

    return FailureFolder(world / "failed").read()


def _map(name: str, world: Path) -> object:
    from lidarplace.scenes.sumo.record import drive
    from lidarplace.scenes.sumo.settings import SumoScene

    town = str(world / "maps" / name)
    scene = SumoScene.model_validate(
        {"towns": [town], "density": 4, "pedestrians": 0, "routes": 1, "test_routes": 0}
        | {"frames_per_route": 2, "warmup_s": 1}
    )
    return drive(scene, scene.town_runs()[0])


AT_ORIGIN = ("--origin", "0", "0", "0", "--only", "*")
LOG = ("log/*.parquet",)
CONVERT = "lidarplace.commands.convert"
SOUND = partial(_nonsense, "log")
QUICK = (
    "--config",
    "sweep.yaml",
    "--placement",
    "mine",
    "--resolution",
    "2",
    "--azimuth-steps",
    "9",
)
"""A LiDAR of few rays, and large voxels."""

DATA: tuple[Target, ...] = (
    Target("box log", LOG, read=_box_log, check=SOUND),
    Target("describe", LOG, "lidarplace.commands.describe", ("log",), check=SOUND),
    Target("view", LOG, "lidarplace.commands.view", ("log", "--placement", "line"), check=SOUND),
    Target(
        "export",
        LOG,
        "lidarplace.commands.export",
        ("log", "out", "--placement", "line"),
        check=SOUND,
    ),
    Target(
        "accuracy",
        LOG,
        "sweeps.commands.accuracy",
        ("log", *QUICK),
        needs=("sweep.yaml",),
        check=SOUND,
    ),
    Target(
        "accuracy of a table",
        ("csv/boxes.csv",),
        "sweeps.commands.accuracy",
        ("csv/boxes.csv", "--frames", "9", *QUICK),
        needs=("sweep.yaml", "log"),
    ),
    Target(
        "run", LOG, "sweeps.commands.run", ("sweep.yaml", "--dry-run"), needs=("sweep.yaml", "log")
    ),
    Target(
        "convert table",
        ("csv/*.csv",),
        CONVERT,
        ("table", "csv", "out"),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert table of Parquet",
        ("parquet/*.parquet",),
        CONVERT,
        ("table", "parquet", "out"),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert table with a number",
        ("csv/boxes.csv",),
        CONVERT,
        ("table", "csv/boxes.csv", "out", "--frames", "9"),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert table --mapping",
        ("labels/labels.csv",),
        CONVERT,
        ("table", "labels/labels.csv", "out", "--mapping", "labels/map.yaml"),
        needs=("labels",),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert table --mapping of Parquet",
        ("labels/labels.parquet",),
        CONVERT,
        ("table", "labels/labels.parquet", "out", "--mapping", "labels/map.yaml"),
        needs=("labels",),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert table --propose",
        ("labels/labels.csv",),
        CONVERT,
        ("table", "labels/labels.csv", "--propose", "guess.yaml"),
    ),
    Target(
        "convert kitti",
        ("kitti/training/label_2/*.txt", "kitti/training/calib/*.txt", "kitti/ImageSets/*.txt"),
        CONVERT,
        ("kitti", "kitti", "out"),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert kitti --skip-bad",
        ("kitti/training/label_2/*.txt", "kitti/training/calib/*.txt", "kitti/ImageSets/*.txt"),
        CONVERT,
        ("kitti", "kitti", "out", "--skip-bad"),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert nuscenes",
        ("nuscenes/*.json",),
        CONVERT,
        ("nuscenes", "nuscenes", "out"),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert argoverse",
        ("av2/val/log-1/*.feather",),
        CONVERT,
        ("argoverse", "av2", "out"),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert waymo",
        ("waymo/training/*/s.parquet",),
        CONVERT,
        ("waymo", "waymo", "out"),
        check=partial(_nonsense, "out"),
    ),
    Target(
        "convert openlabel",
        ("openlabel/drive.json",),
        CONVERT,
        ("openlabel", "openlabel", "out", "--origin", "0", "0", "0"),
        check=partial(_nonsense, "out"),
    ),
    *(
        Target(
            f"rig {name}",
            (f"rigs/{name}{files}",),
            "lidarplace.commands.rig",
            (f"rigs/{name}{suffix}", "out.yaml", "--format", name, *AT_ORIGIN),
        )
        for name, suffix, files in (
            ("nuscenes", "", "/*.json"),
            ("urdf", ".urdf", ".urdf"),
            ("ros2", ".launch.xml", ".launch.xml"),
            ("carla", ".json", ".json"),
            ("osi", ".json", ".json"),
        )
    ),
    Target(
        "KITTI clouds", ("kitti/training/velodyne/*.bin",), read=_kitti_clouds, needs=("kitti",)
    ),
    Target(
        "sensors fit",
        ("cloud.parquet",),
        "lidarplace.commands.sensors",
        ("fit", "cloud.parquet", "--out", "lidar.yaml"),
    ),
    Target("recorded clouds", ("clouds/route/*.npy",), read=_recorded),
    Target("rig of clouds", ("clouds/placement.json",), read=_rig),
    Target("checkpoint", ("base.pt",), read=_checkpoint),
    Target("run folder", ("run/*.parquet", "run/*.npz", "run/config.yaml"), read=_run_folder),
    Target("search folder", ("found/*.parquet", "found/*.npz"), read=_search_folder),
    Target("failures", ("failed/*.json",), read=_failures),
)
"""Data of all kinds."""

MAPS: tuple[Target, ...] = tuple(
    Target(f"map {name}", (f"maps/{name}",), read=partial(_map, name))
    for name in ("block.net.xml", "street.xodr")
)
"""They start SUMO."""

REPORTS: tuple[Target, ...] = (
    Target("report", ("run/*.parquet", "run/*.npz"), "tracking.report.command", ("run",)),
    Target(
        "search-report",
        ("found/*.parquet", "found/*.npz"),
        "tracking.search_report.command",
        ("found",),
    ),
)
"""Whole reports: a second each."""

SETTINGS: tuple[Target, ...] = (
    Target(
        "run", ("sweep.yaml",), "sweeps.commands.run", ("sweep.yaml", "--dry-run"), needs=("log",)
    ),
    Target(
        "search",
        ("search.yaml",),
        "sweeps.commands.search",
        ("search.yaml", "--dry-run"),
        needs=("log",),
    ),
    Target(
        "status",
        ("sweep.yaml", "search.yaml"),
        "sweeps.commands.status",
        ("{}", "--json"),
        needs=("log",),
    ),
    Target(
        "doctor",
        ("sweep.yaml",),
        "sweeps.commands.doctor",
        ("sweep.yaml",),
        needs=("log",),
        codes=(0, 1),
    ),
    Target(
        "clean",
        ("sweep.yaml", "search.yaml"),
        "sweeps.commands.clean",
        ("{}", "--dry-run"),
        needs=("log", "runs"),
    ),
    Target(
        "requirements",
        ("needs.yaml",),
        "sweeps.commands.requirements",
        ("needs.yaml",),
        codes=(0, 1),
    ),
    Target(
        "accuracy --config",
        ("sweep.yaml",),
        "sweeps.commands.accuracy",
        ("log", *QUICK),
        needs=("log",),
    ),
    Target(
        "view --placement",
        ("rig.yaml",),
        "lidarplace.commands.view",
        ("log", "--placement", "rig.yaml"),
        needs=("log",),
    ),
    Target(
        "export --placement",
        ("rig.yaml",),
        "lidarplace.commands.export",
        ("log", "out", "--placement", "rig.yaml"),
        needs=("log",),
    ),
    Target(
        "rig",
        ("rig.yaml",),
        "lidarplace.commands.rig",
        ("rig.yaml", "out.urdf", "--origin", "0", "0", "0"),
    ),
    Target(
        "convert --class-map",
        ("classes.yaml",),
        CONVERT,
        ("table", "csv", "out", "--class-map", "classes.yaml"),
        needs=("csv",),
    ),
    Target(
        "mapping",
        ("labels/map.yaml",),
        CONVERT,
        ("table", "labels/labels.csv", "out", "--mapping", "labels/map.yaml"),
        needs=("labels",),
    ),
    Target(
        "carla",
        ("carla.yaml",),
        "lidarplace.plugins.carla.command",
        ("carla.yaml", "out", "--host", "127.0.0.1", "--port", "1", "--timeout", "0.1"),
    ),
    Target("run folder's sweep.json", ("run/sweep.json",), read=_run_folder),
    Target("search folder's search.json", ("found/search.json",), read=_search_folder),
)
"""Settings that people write, and what results say of them."""
