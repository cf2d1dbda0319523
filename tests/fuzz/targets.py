"""Everything that reads input: verbs with their command lines, and readers that no verb reaches."""

import importlib
import os
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pandas as pd

from sweeps.command_line import VERBS
from tests.fuzz.world import CROP, FRAMES


@dataclass(frozen=True)
class Target:
    """Something that reads files of the world.

    Attributes:
        name: for the table of counts; the verb and what it reads.
        files: what is made wrong, patterns in the world; "" where it is the command line.
        line: the verb's command line in the world, "" for a reader.
        needs: what is copied beside what `line` names.
        read: the reader, given the world.
        codes: exit codes that say no mistake of the input.
        check: of what was done; returns what is nonsense in it.
        stops_at: function whose call means that the command line was taken.
    """

    name: str
    files: str = ""
    line: str = ""
    needs: str = ""
    read: Callable[[Path], object] | None = None
    codes: tuple[int, ...] = (0,)
    check: Callable[[Path], str] = field(default=lambda world: "")
    stops_at: str = ""

    @property
    def arguments(self) -> list[str]:
        """Words of the command line after its verb."""
        return self.line.split()[1:]


def app_of(line: str) -> Any:
    """Application of the verb of a command line."""
    return import_module(VERBS[line.split()[0]].module).app


def parts_of(line: str, world: Path) -> set[str]:
    """Entries of the world that a command line names, and the log that configurations name."""
    return {"log"} | {word.split("/")[0] for word in line.split()} & {*os.listdir(world)}


def _nonsense(name: str, world: Path) -> str:
    """Find what no box log may hold, without the reader; "" if there is nothing."""
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


def _read(function: str, name: str, world: Path) -> object:
    """Call a function, `module:name`, with a file or a folder of the world."""
    return resolve_name(function)(world / name)


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


def _correction(world: Path) -> object:
    from pydantic import ValidationError

    from lidarplace.clouds.raycast import beams_of
    from lidarplace.configuration.correction import read_correction
    from lidarplace.configuration.sensor import SensorSettings
    from lidarplace.configuration.settings import fault

    path = str(world / "correction.yaml")
    read_correction(path)
    try:
        return beams_of(SensorSettings(beams=3, correction=path, unit="up").lidar())
    except ValidationError as error:
        raise fault(error) from None


def _network(world: Path) -> object:
    """The plan of a sweep whose network is in its folder, as a new process reads it."""
    from lidarplace.base.code_version import forget_versions
    from lidarplace.base.plugin_folders import PLUGINS
    from sweeps.plan.plan import read_plan
    from training import NETWORKS
    from training.detectors.build import PLUG_INS

    for cache in (PLUGINS, NETWORKS._added, PLUG_INS._added):
        cache.clear()
    forget_versions()
    importlib.invalidate_caches()
    sys.modules.pop("fuzz_net", None)
    return read_plan(world / "own.yaml", [])


def _predictor(world: Path) -> object:
    from sweeps.benchmark.predictors import resolved

    return resolved(str(world / "judge.pt"))


def _checkpoint(world: Path) -> object:
    from training import build_detector
    from training.checkpoints import load_checkpoint

    return load_checkpoint(build_detector("pointpillars_tiny", ["Car"]), world / "base.pt")


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


CLOUD_READER = "lidarplace.clouds.cloud_files:read_cloud"
_box_log = partial(_read, "lidarplace.logs.box_log:read_box_log")
_run_folder = partial(_read, "tracking.run_folders.sweep:RunFolder.read", "run")
_search_folder = partial(_read, "tracking.run_folders.search:SearchFolder.read", "found")
LOG = "log/*.parquet"
KITTI = "kitti/training/label_2/*.txt kitti/training/calib/*.txt kitti/ImageSets/*.txt"
RUN, FOUND = "run/*.parquet run/*.npz", "found/*.parquet found/*.npz"
MAPPED = "out --mapping labels/map.yaml"
AV2, CLOUDS = "av2/val/log-1", "argoverse av2 out --clouds av2"
TRUCK, PANDA, OPV2V = "truckscenes", "pandaset/001", "opv2v/train/2021_train"
TRUCK_MODELS = "--lidar LIDAR_LEFT=pandar64,LIDAR_TOP_FRONT=os1_128"
PANDA_RIG = "--lidar front_gt=m1 --origin -0.7 0 2"
SOUND, WHOLE = partial(_nonsense, "log"), partial(_nonsense, "out")
"""A LiDAR of few rays, and large voxels."""

DATA: tuple[Target, ...] = (
    Target("box log", LOG, read=partial(_box_log, "log"), check=SOUND),
    Target("sensors fit", "cloud.parquet", "sensors fit cloud.parquet --out lidar.yaml"),
    Target(
        "recorded log",
        "recorded/rig.json recorded/boxes.parquet",
        read=partial(_box_log, "recorded"),
    ),
    Target("validate", "recorded/rig.json recorded/boxes.parquet", "validate recorded --out out"),
    Target("describe", LOG, "describe log", check=SOUND),
    Target("view", LOG, "view log --placement line", check=SOUND),
    Target("export", LOG, "export log out --placement line", check=SOUND),
    Target("run", LOG, "run sweep.yaml --dry-run"),
    *(
        Target(f"convert {name}", files, f"convert {line}", check=WHOLE)
        for name, files, line in (
            ("table", "csv/*.csv", "table csv out"),
            ("table of Parquet", "parquet/*.parquet", "table parquet out"),
            ("table with a number", "csv/boxes.csv", "table csv/boxes.csv out --frames 9"),
            ("table --mapping", "labels/labels.csv", f"table labels/labels.csv {MAPPED}"),
            (
                *("table --mapping of Parquet", "labels/labels.parquet"),
                f"table labels/labels.parquet {MAPPED}",
            ),
            ("table of JSON", "frames/*.json", "table frames out --mapping frames/map.yaml"),
            ("table of JSON lines", "labels/labels.jsonl", f"table labels/labels.jsonl {MAPPED}"),
            ("kitti", KITTI, "kitti kitti out"),
            ("kitti --skip-bad", KITTI, "kitti kitti out --skip-bad"),
            ("nuscenes", "nuscenes/*.json", "nuscenes nuscenes out"),
            ("argoverse", f"{AV2}/*.feather {AV2}/calibration/*.feather", "argoverse av2 out"),
            ("argoverse --clouds", f"{AV2}/sensors/lidar/*.feather", CLOUDS),
            ("waymo", "waymo/training/*/s.parquet", "waymo waymo out"),
            ("openlabel", "openlabel/drive.json", "openlabel openlabel out --origin 0 0 0"),
            (
                *("truckscenes", f"{TRUCK}/v1.0-mini/*.json {TRUCK}/samples/*/*.pcd"),
                f"truckscenes {TRUCK} out --clouds {TRUCK} {TRUCK_MODELS}",
            ),
            (
                *("pandaset", f"{PANDA}/annotations/cuboids/*.gz {PANDA}/lidar/*.*"),
                f"pandaset pandaset out --clouds pandaset {PANDA_RIG}",
            ),
            (
                *("opv2v", f"{OPV2V}/*.yaml {OPV2V}/*/*.yaml {OPV2V}/*/*.pcd"),
                "opv2v opv2v out --clouds opv2v",
            ),
            (
                "openpcdet",
                "openpcdet/labels/*.txt openpcdet/ImageSets/*.txt openpcdet/points/*.npy",
                "openpcdet openpcdet out --clouds openpcdet",
            ),
        )
    ),
    Target(
        "convert table --propose",
        "labels/labels.csv",
        "convert table labels/labels.csv --propose guess.yaml",
    ),
    *(
        Target(
            f"rig {name}",
            f"rigs/{name}{files}",
            f"rig rigs/{name}{suffix} out.yaml --format {name} --origin 0 0 0 --only *",
        )
        for name, suffix, files in (
            ("nuscenes", "", "/*.json"),
            ("urdf", ".urdf", ".urdf"),
            ("ros2", ".launch.xml", ".launch.xml"),
            ("carla", ".json", ".json"),
            ("osi", ".json", ".json"),
            ("autoware", "sensors_calibration.yaml", "sensors_calibration.yaml"),
        )
    ),
    *(
        Target(f"sensors import {name}", f"makers/{name}", f"sensors import makers/{name}")
        for name in ("os0.json", "xt32.csv", "vlp4db.yaml", "hdl3.xml")
    ),
    Target("compressed cloud", "cloud.pcd", read=partial(_read, CLOUD_READER, "cloud.pcd")),
    Target("KITTI clouds", "kitti/training/velodyne/*.bin", read=_kitti_clouds),
    Target("recorded clouds", "clouds/route/*.npy", read=_recorded),
    Target("rig of clouds", "clouds/placement.json", read=_rig),
    Target("checkpoint", "base.pt", read=_checkpoint),
    Target("run folder", f"{RUN} run/config.yaml", read=_run_folder),
    Target("search folder", FOUND, read=_search_folder),
    Target("failures", "failed/*.json", read=_failures),
    Target("benchmark", "judge.pt", read=_predictor),
)
"""Data of all kinds."""

DETECTIONS: tuple[Target, ...] = tuple(
    Target(
        f"evaluate {layout}",
        f"detected/{layout}/found{files}",
        f"evaluate detected/{layout}/log detected/{layout}/found{file}",
    )
    for layout, file, files in (
        ("kitti", "", "/*.txt"),
        ("nuscenes", ".json", ".json"),
        ("argoverse", ".feather", ".feather"),
        ("waymo", ".parquet", ".parquet"),
        ("parquet", ".parquet", ".parquet"),
    )
)
"""Files of detections from elsewhere."""

MAPS: tuple[Target, ...] = tuple(
    Target(f"map {name}", f"maps/{name}", read=partial(_map, name))
    for name in ("block.net.xml", "street.xodr")
)
"""They start SUMO."""

REPORTS: tuple[Target, ...] = (
    Target("report", RUN, "report run"),
    Target("search-report", FOUND, "search-report found"),
)
"""Whole reports: a second each."""

SETTINGS: tuple[Target, ...] = (
    Target("run", "sweep.yaml", "run sweep.yaml --dry-run"),
    Target("search", "search.yaml", "search search.yaml --dry-run"),
    Target("status", "sweep.yaml search.yaml", "status {} --json"),
    Target("doctor", "sweep.yaml", "doctor sweep.yaml", codes=(0, 1)),
    Target("clean", "sweep.yaml search.yaml", "clean {} --dry-run", needs="runs"),
    Target("requirements", "needs.yaml", "requirements needs.yaml", codes=(0, 1)),
    Target("view --placement", "rig.yaml", "view log --placement rig.yaml"),
    Target("export --placement", "rig.yaml", "export log out --placement rig.yaml"),
    Target("rig", "rig.yaml", "rig rig.yaml out.urdf --origin 0 0 0"),
    Target("correction", "correction.yaml", read=_correction),
    Target("convert --class-map", "classes.yaml", "convert table csv out --class-map classes.yaml"),
    Target("mapping", "labels/map.yaml", f"convert table labels/labels.csv {MAPPED}"),
    Target("carla", "carla.yaml", "carla carla.yaml out --host 127.0.0.1 --port 1 --timeout 0.1"),
    Target("run folder's sweep.json", "run/sweep.json", read=_run_folder),
    Target("search folder's search.json", "found/search.json", read=_search_folder),
    Target("network", "own.yaml fuzz_net.py", needs="own.yaml fuzz_net.py", read=_network),
    Target("run command", "command.yaml", "run command.yaml --dry-run", needs="rig.yaml rigs"),
)
"""Settings that people write, and what results say of them."""
