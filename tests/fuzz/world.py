"""Right files, tiny, of every kind that something reads. A case takes a copy and makes it wrong."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from sweeps.store.entries import SWEEPS
from tests.lidarplace import argoverse_layout, nuscenes_layout, small_data_sets, waymo_layout
from tests.lidarplace.company_table import Manner, mapping_of, traffic, write_in_manner
from tests.sweeps.small_log import write_small_log
from tests.tracking.made_up_run import write_run
from tests.tracking.made_up_search import write_search

MAPS = Path(__file__).parents[1] / "data" / "maps"

SWEEP = {
    "scene": {"source": "log", "folder": "log"},
    "classes": ["Car"],
    "roi": {"x": [0, 40], "y": [-20, 20], "z": [0, 4]},
    "lidar": {"beams": 4, "azimuth_steps": 90},
    "surrogate": {"resolution": 0.8, "accuracy": False, "sampling_error": False},
    "training": {"epochs": 1, "batch_size": 2, "rotation": 0.1},
    "placements": {"mine": {"mounts": [{"x": 0.5, "y": 0.6, "z": 2.0, "roll": -0.1}]}},
    "grid": {"placement": ["line", "mine"], "seed": [1]},
    "ray": "debug",
}

SEARCH = {
    **{key: SWEEP[key] for key in ("scene", "classes", "lidar", "surrogate", "ray")},
    "search": {
        "lidars": 2,
        "zones": {"roof": {"x": [-0.5, 0.5], "y": [-0.6, 0.6], "z": [1.6, 1.8]}},
        "roll_deg": [-10, 10],
        "constraints": {"distance": 0.2},
        "objective": "expected_ig",
        "azimuth_stride": 1,
        "trials": 4,
        "batch_size": 4,
        "greedy": {"position_step": 0.5, "bound_seconds": 1.0},
    },
    "robustness": {"draws": 2},
}

CARLA = {
    "scene": {"towns": ["Town03"]},
    "placements": {"line": None, "mine": {"mounts": [{"x": 0.5, "z": 2.0}]}},
}

REQUIREMENTS = {
    "lidar": {"beams": 4, "azimuth_steps": 36},
    "placements": {"mine": {"mounts": [{"x": 0.5, "z": 2.0}, {"z": 1.8, "pitch": 0.3}]}},
    "rigs": ["mine", "line"],
    "requirements": [
        {
            "name": "people",
            "where": {"distance": [0.2, 2.0], "sectors": ["front", [90, 180]]},
            "what": "Pedestrian",
            "at_least": {"points": 1},
            "for": 0.9,
            "also_when": {"one_lidar_dead": True, "range_factor": 0.5},
            "step": 1.0,
        },
        {
            "name": "ground",
            "where": {"lanes": ["own"], "x": [-5, 5], "z": [0, 1]},
            "at_least": {"coverage": 0.1},
            "step": 0.5,
        },
    ],
}

NETWORK = """
from training.detectors.detector import Detector

class Net(Detector):
    def loss(self, points, boxes, labels):
        return {"loss": boxes}

    def predict(self, points, selection=None):
        return []

def build(classes, preset, point_range, typical):
    return Net(classes, point_range)
"""

OWN = {
    "scene": {"source": "log", "folder": "log"},
    "classes": ["Car"],
    "detector": "fuzz_net:build",
    "training": {"epochs": 1},
    "placement": "line",
}

CROP = (-50.0, -50.0, -3.0, 50.0, 50.0, 5.0)
"""Region of the recorded clouds."""

FRAMES = np.array([0, 1])
"""Frames of the recorded clouds."""


CORRECTION = """
factor: {Car: 0.62, other: 0.6}
distance: 75.0
lidars:
  up:
    azimuth_steps: 900
    elevations_deg: [-10.0, 0.0, 5.0]
    mask: {azimuth_deg: 120, elevation_deg: [-5.0], shares: [[0.1, 1.0, 0.5], [1.0, 1.0, 0.2]]}
fitted: {routes: 4}
"""

COMMAND = {
    "detector": "second",
    "evaluator": {
        "command": "{python} judge.py {clouds} {detections} {rig} {seed}",
        "format": "parquet",
        "name": "mine",
        "folder": ".",
        "depends_on": ["rig.yaml", "rigs"],
        "cpus": 2,
        "gpus": 1,
        "time_limit": 60,
    },
}
"""A command as the evaluator, besides what a sweep has."""


def write_world(folder: Path) -> None:
    """Write all of it into a new folder."""
    folder.mkdir(parents=True)
    write_small_log(folder / "log")
    buildings = pd.DataFrame([("a", 20.0, 9.0, 3.0, 6.0, 4.0, 6.0, 0.1)])
    buildings.columns = ["scene", "x", "y", "z", "length", "width", "height", "yaw"]
    buildings.to_parquet(folder / "log/buildings.parquet")
    frames = pd.read_parquet(folder / "log/frames.parquet")
    frames.assign(ego_x=0.0, ego_y=0.0, ego_yaw=0.0).to_parquet(folder / "log/frames.parquet")
    _tables(folder)
    _labels(folder / "labels")
    _json_frames(folder / "frames")
    shutil.copytree(MAPS.parent / "makers", folder / "makers")
    _kitti(folder / "kitti")
    write_data_sets(folder, "nuscenes", "av2", both=False)
    small_data_sets.write_truckscenes(folder / "truckscenes/v1.0-mini", scenes=("scene-a-1",))
    small_data_sets.write_pandaset(folder / "pandaset", sequences=("001",))
    small_data_sets.write_opv2v(folder / "opv2v", splits=("train",))
    small_data_sets.write_openpcdet(folder / "openpcdet")
    _clouds(folder)
    _detections(folder / "detected")
    _recorded(folder / "recorded")
    write_run(folder / "run", names=("line", "center", "mine"), points=20)
    write_search(folder / "found", trials=12)
    (folder / "maps").mkdir()
    for path in MAPS.iterdir():
        (folder / "maps" / path.name).write_bytes(path.read_bytes())
    for name, content in (
        ("sweep", SWEEP),
        ("command", SWEEP | COMMAND),
        ("search", SEARCH),
        ("carla", CARLA),
        ("needs", REQUIREMENTS),
        ("own", OWN),
    ):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    (folder / "rig.yaml").write_text(yaml.safe_dump(SWEEP["placements"]["mine"]))
    (folder / "fuzz_net.py").write_text(NETWORK)
    (folder / "correction.yaml").write_text(CORRECTION)
    (folder / "classes.yaml").write_text("Sedan: Car\nDog: ignore\n")
    _rigs(folder / "rigs")
    _checkpoint(folder / "base.pt", ["Car"])
    _checkpoint(folder / "judge.pt", ["Car", "Cyclist", "Pedestrian"])  # the classes of the study
    store = folder / "runs/store"
    (store / SWEEPS).mkdir(parents=True)
    (store / SWEEPS / "old.json").write_text("[]")
    (folder / "runs/mlflow.db").write_text("nobody opens it")
    (folder / "failed").mkdir()
    failure = '{"reason": "no", "log": "", "lasting": true, "out_of_gpu_memory": false}'
    (folder / "failed/0123456789abcdef.json").write_text(failure)


def _rigs(folder: Path) -> None:
    """A rig in the format of every other tool."""
    from lidarplace.configuration.sensor import SensorSettings
    from lidarplace.rig_files.formats import FORMATS
    from lidarplace.rig_files.mounted import RigSensor
    from lidarplace.rigs.placement import Mount

    folder.mkdir()
    model = SensorSettings(name="vlp32c")
    rig = [RigSensor("roof", Mount(z=2.0), model), RigSensor("left", Mount(0, 1, 1), model)]
    for name, mount_format in FORMATS.items():
        suffix = ".json" if name in ("carla", "osi") else (*mount_format.suffixes, "")[0]
        mount_format.write(folder / f"{name}{suffix}", rig)


def _tables(folder: Path) -> None:
    boxes = pd.read_parquet(folder / "log/boxes.parquet")
    frames = pd.read_parquet(folder / "log/frames.parquet")
    for suffix in ("csv", "parquet"):
        (folder / suffix).mkdir()
        for name, table in (("boxes", boxes), ("frames", frames)):
            path = folder / suffix / f"{name}.{suffix}"
            table.to_csv(path, index=False) if suffix == "csv" else table.to_parquet(path)


def _labels(folder: Path) -> None:
    """Traffic of two drives in a company's manner; with poses."""
    folder.mkdir()
    log = traffic(drives=2, frames=4)
    manner = Manner(coordinates="world")
    table = write_in_manner(log, manner)
    mapping = mapping_of(log, manner)
    mapping["classes"] = {**mapping["classes"], "bicyclist": "Two-Wheeler"}  # of one's own
    table.to_csv(folder / "labels.csv", index=False)
    table.to_parquet(folder / "labels.parquet")
    table.to_json(folder / "labels.jsonl", orient="records", lines=True)
    (folder / "map.yaml").write_text(yaml.safe_dump(mapping, sort_keys=False))


def _json_frames(folder: Path) -> None:
    """A JSON file a frame, with its mapping."""
    from lidarplace.scenes.label_tables.propose import propose_mapping

    shutil.copytree(MAPS.parent / "labels/sustech/drive/label", folder)
    text = propose_mapping(folder).replace("sense: }", "sense: clockwise}")
    (folder / "map.yaml").write_text(text)


def _kitti(folder: Path) -> None:
    from lidarplace.scenes.kitti.calibration import calibration_text

    label = "Car 0.00 0 -1.58 587.01 173.33 614.12 200.12 1.65 1.67 3.64 -0.65 1.71 46.70 -1.59"
    for name in ("label_2", "calib", "velodyne"):
        (folder / "training" / name).mkdir(parents=True)
    (folder / "ImageSets").mkdir()
    (folder / "ImageSets/train.txt").write_text("000000\n000001\n")
    (folder / "ImageSets/val.txt").write_text("000002\n")
    points = np.array([[10, 1, -1, 0.5], [20, -3, 0, 0.1]], "<f4")
    for frame in range(3):
        stem = f"{frame:06d}"
        (folder / f"training/label_2/{stem}.txt").write_text(f"{label}\n{label}\n")
        (folder / f"training/calib/{stem}.txt").write_text(calibration_text())
        (folder / f"training/velodyne/{stem}.bin").write_bytes(points.tobytes())


def write_data_sets(folder: Path, nuscenes: str, argoverse: str, both: bool) -> None:
    """nuScenes and Argoverse 2 at these places below `folder`, Waymo and OpenLABEL; `both`: splits
    to train and to test where they are files of their split, else one."""
    boxes = [nuscenes_layout.Box("vehicle.car", (9.0, 0.0, 1.0))]
    samples = [nuscenes_layout.Sample(5, boxes), nuscenes_layout.Sample(6)]
    scenes = [nuscenes_layout.Scene(f"scene-{n}", samples, f"log-{n}") for n in range(2)]
    nuscenes_layout.write_nuscenes(folder / nuscenes, scenes, ["vehicle.car", "animal"])
    box = argoverse_layout.Box(5, "REGULAR_VEHICLE", (9.0, 0.0, 1.0))
    level = argoverse_layout.LEVEL
    poses = dict.fromkeys((5, 6), (level, (0.0, 0.0, 0.0)))
    mounts = {"up_lidar": (level, (1.35, 0.0, 1.64)), "down_lidar": (level, (1.35, 0.0, 1.53))}
    splits = [("train", "log-0"), ("val", "log-1")][not both :]
    logs = [argoverse_layout.Log(*split, [box, box], poses, [5, 6], mounts) for split in splits]
    argoverse_layout.write_argoverse(folder / argoverse, logs)
    car, poses = waymo_layout.Box(5, 1, (9.0, 0.0, 1.0)), {5: np.eye(4), 6: np.eye(4)}
    of_segment = (poses, [car, car], {1: (np.eye(4), [-0.3, 0.0, 0.1])})
    splits = [("training", "s"), ("validation", "t")][: 1 + both]
    segments = [waymo_layout.Segment(*split, *of_segment) for split in splits]
    waymo_layout.write_waymo(folder / "waymo", segments)
    (folder / "openlabel").mkdir()
    drive = (MAPS.parent / "openlabel/drive.json").read_text()
    (folder / "openlabel/drive.json").write_text(drive.replace("kiosk", "Cyclist"))


def _clouds(folder: Path) -> None:
    import json

    from lidarplace.clouds.clouds import PointClouds, write_clouds
    from lidarplace.clouds.recorded import rig_record
    from lidarplace.rigs.lidar import Lidar
    from lidarplace.rigs.placement import PAPER_PLACEMENTS
    from tests.lidarplace.test_cloud_files import CLOUD, pcd
    from tests.lidarplace.test_sensors_fit import cloud_of

    random = np.random.default_rng(0)
    clouds = [(random.uniform(0, 1, (50, 4)).astype(np.float32), [20, 30]) for _ in FRAMES]
    write_clouds(folder / "clouds/route", PointClouds.from_frames(FRAMES, clouds, CROP))
    cloud_of(Lidar.even(6, (-15, 5), 120)).to_parquet(folder / "cloud.parquet", index=False)
    (folder / "cloud.pcd").write_bytes(pcd(CLOUD, "binary_compressed"))
    record = json.dumps(rig_record(PAPER_PLACEMENTS["line"]))
    (folder / "clouds/placement.json").write_text(record)


def _detections(folder: Path) -> None:
    """Labels of a log as the detections of every layout, with the log that names their frames."""
    from lidarplace.detections.read import LAYOUTS
    from lidarplace.logs.box_log import write_box_log
    from tests.lidarplace.test_detections import log_of, scored, write

    for layout in LAYOUTS:
        log = log_of(layout, 3)
        write_box_log(folder / layout / "log", log)
        write(layout, folder / layout / "found", log, scored(log.boxes))


def _recorded(folder: Path) -> None:
    from lidarplace.logs.box_log import read_box_log, write_box_log
    from lidarplace.rigs.placement import PAPER_PLACEMENTS
    from lidarplace.rigs.recorded import RecordedRig

    write_small_log(folder)
    log = read_box_log(folder)
    rig = RecordedRig(("a", "b", "c", "d"), PAPER_PLACEMENTS["line"])
    boxes = log.boxes.assign(points=3.0, **{"points/a": 1.0})
    rigs = dict.fromkeys(log.frames["scene"].unique(), rig)
    write_box_log(folder, replace(log, boxes=boxes, rigs=rigs))


def _checkpoint(path: Path, classes: list[str]) -> None:
    from training import build_detector
    from training.checkpoints import write_checkpoint

    at = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)
    model = build_detector("pointpillars_tiny", classes, point_range=at)
    write_checkpoint(path, model.state_dict(), "pointpillars_tiny", classes)
