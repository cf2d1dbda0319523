"""Configurations of sweeps over the rigs of a studio, and what such a sweep has found."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.roi import Roi
from lidarplace.files.columns import check_columns
from lidarplace.files.tables import read_csv
from lidarplace.mounting.random_rigs import has_other_lidar, random_rigs
from lidarplace.mounting.vehicle import depth_in_body
from lidarplace.mounting.zone import position
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement
from lidarplace.studio.rig import POSE, Rig
from lidarplace.studio.rigs_file import RigsFile
from lidarplace.studio.violations import check_sweepable

Content = dict[str, Any]
"""Of a configuration, as plain data."""

RUNS = Path("runs")
"""The folder of run folders, as of any sweep."""
TRAINED_ON = 16
"""Rigs on which a generalist is trained, …"""
LEAST_OF_MODELS = 4
"""… and at least so many with the same LiDAR models."""
IN_ZONES = 4
"""For each rig of the studio so many with its LiDARs elsewhere in the zones: what a generalist is
trained on is drawn around all of them, so that it knows the zones."""
JUDGE: Content = {
    "judge": "generalist",
    "generalist": {"rigs_per_frame": 4, "epochs": 4},
    "mounting_errors": {"offset": 0.01, "angle_deg": 0.5},
    "surrogate": {"names": ["covered_entropy"], "accuracy": False, "sampling_error": False},
}
"""An evaluation, where its file does not say otherwise."""
INTERVAL = ("mean", "low", "high")


def sweep_of(
    rigs: Sequence[Rig], file: RigsFile, scene: Mapping[str, Any], roi: Roi, classes: Sequence[str]
) -> Content:
    """The configuration of a sweep over the rigs that have LiDARs.

    Args:
        scene: the traffic, as a configuration has it.

    Raises:
        ValueError: no rig has a LiDAR, or one is inside of the body or sees nothing of the ROI.
    """
    for rig in rigs:
        check_sweepable(rig, file, roi)
    placements = {rig.name: rig.written for rig in rigs if rig.lidars}
    if not placements:
        raise ValueError("no rig has a LiDAR; a sweep needs one")
    same = ("requirements", "allow_blind_lidars")
    return {
        **_vehicle(file),
        **{key: file.content[key] for key in same if key in file.content},
        "scene": dict(scene),
        "roi": {axis: list(getattr(roi, axis)) for axis in "xyz"},
        "classes": list(classes),
        "lidar": file.content.get("lidar", {}),
        "surrogate": {"resolution": roi.resolution},
        "placements": placements,
        "grid": {"placement": list(placements)},
    }


def _vehicle(file: RigsFile) -> Content:
    """The key `vehicle` of a sweep, with what the file keeps out; none for a sedan."""
    if file.carrier is None:
        return {}
    told = file.settings.vehicle
    own = {} if told is None else told.model_dump(mode="json", exclude_defaults=True)
    return {"vehicle": own | {"boxes": file.carrier.boxes.tolist()}}


def evaluation_of(sweep: Content, file: RigsFile, before: Content | None = None) -> Content:
    """The same, judged by a generalist: it is trained once, and then judges rigs in seconds.

    What it is trained on is drawn around the rigs of the sweep and in the zones of the file.

    Args:
        sweep: of `sweep_of`.
        before: an earlier evaluation, which is brought up to date: how it judges stays, and so does
            its generalist, unless a rig has a LiDAR model that this one has not seen.
    """
    content = JUDGE | (before or {})
    content["surrogate"] = content["surrogate"] | sweep["surrogate"]
    settings = content["generalist"]
    named, there = settings.get("rigs"), content.get("placements", {})
    known = (
        {name: there[name] for name in named if name in there} if isinstance(named, list) else {}
    )
    trained = _placements(known, file)
    judged = _placements(sweep["placements"], file)
    if not trained or any(has_other_lidar(rig, trained) for rig in judged):
        known = _drawn(sweep["placements"], file)
    return {
        **content,
        **{key: own for key, own in sweep.items() if key not in ("surrogate", "grid")},
        "placements": sweep["placements"] | known,
        "generalist": settings | {"rigs": list(known)},
        "grid": content.get("grid", {}) | sweep["grid"],
        "output": str(RUNS),
    }


def is_evaluation(content: Any) -> bool:
    """Whether a file's content can be brought up to date by `evaluation_of`."""
    if not isinstance(content, dict) or content.get("judge") != JUDGE["judge"]:
        return False
    mappings = (content.get(key, {}) for key in ("placements", "generalist", "surrogate", "grid"))
    return all(isinstance(own, dict) for own in mappings)


def _placements(written: Mapping[str, Content], file: RigsFile) -> list[Placement]:
    lidar = file.settings.lidar.lidar()
    found = (Rig.of_written(name, own).placement(lidar) for name, own in written.items())
    return [rig for rig in found if rig is not None]


def _drawn(written: Mapping[str, Content], file: RigsFile) -> dict[str, Content]:
    """Rigs to train on, by name: of every set of LiDAR models some."""
    models: dict[Lidar, Content] = {}
    for name, own in written.items():
        rig = Rig.of_written(name, own)
        for lidar, mounted in zip(rig.models(file.settings.lidar.lidar()), rig.lidars, strict=True):
            models[lidar] = {key: mounted.written[key] for key in mounted.written if key == "lidar"}
    by_models: dict[tuple[Lidar, ...], list[Placement]] = {}
    for placement in _placements(written, file):
        by_models.setdefault(placement.lidars, []).extend([placement, *_elsewhere(placement, file)])
    of_each = max(LEAST_OF_MODELS, TRAINED_ON // len(by_models))
    drawn = [rig for around in by_models.values() for rig in random_rigs(around, of_each, seed=0)]
    return {
        f"trained_{number}": {
            "mounts": [
                dict(zip(POSE, (round(float(value), 4) for value in astuple(mount)), strict=True))
                | models[lidar]
                for mount, lidar in zip(rig.mounts, rig.lidars, strict=True)
            ]
        }
        for number, rig in enumerate(drawn, start=1)
    }


def _elsewhere(rig: Placement, file: RigsFile) -> Iterator[Placement]:
    """The rig with its LiDARs at other places of the zones."""
    random = np.random.default_rng(0)
    for _ in range(IN_ZONES if file.zones else 0):
        zones = random.choice(len(file.zones), len(rig.mounts))
        places = [position(file.zones[zone], *random.random(3)) for zone in zones]
        apart = len({*places}) == len(places)  # two in one place are no rig
        if apart and not depth_in_body(file.body, np.array(places)).any():
            moved = zip(rig.mounts, places, strict=True)
            yield replace(rig, mounts=[replace(mount, x=x, y=y, z=z) for mount, (x, y, z) in moved])


def found_by_sweep(run: Path) -> dict[str, pd.DataFrame]:
    """AP and recall by what they are of, from the tables of a run folder's report.

    Returns:
        Tables by the name of the metric: index `placement`, columns `mean`, `low` and `high`, the
        ends of the 95 % interval, in percent; NaN where it is not known.

    Raises:
        OSError, ValueError: a table cannot be read.
    """
    tables = {}
    for path in sorted((run / "tables").glob("best-*.csv")):
        table = read_csv(path)
        check_columns(list(table.columns), ["placement", *INTERVAL], str(path))
        metric = path.stem.removeprefix("best-").replace("-", " ")
        tables[metric] = table.set_index("placement")[list(INTERVAL)]
    return tables
