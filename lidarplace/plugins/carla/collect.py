"""Collect a scene: drive its routes, write the box log, show every route to every placement.

    OUT/scene.json                        settings; a folder holds one scene
    OUT/routes/<route>/                   recorded traffic
    OUT/boxes.parquet, frames.parquet, buildings.parquet
    OUT/clouds/<placement>/placement.json
    OUT/clouds/<placement>/<route>/       point clouds

What is there is not done again: a collection that was stopped goes on with the next route, and
placements can be added later under the same traffic."""

import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import PointClouds, write_clouds
from lidarplace.clouds.points_in_boxes import count_points
from lidarplace.clouds.recorded import rig_record
from lidarplace.files.atomic import write_text
from lidarplace.files.json_file import read_json
from lidarplace.logs.box_log import BoxLog, join_logs, read_box_log, write_box_log
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.plugins.carla.drive import Report, drive
from lidarplace.plugins.carla.replay import replay
from lidarplace.plugins.carla.server import connect
from lidarplace.plugins.carla.settings import CarlaScene
from lidarplace.plugins.carla.traffic import Traffic, box_log
from lidarplace.rig_files.carla import check_possible
from lidarplace.rigs.placement import Placement

NEAR_M = 15.0  # so near, few things are hidden, and what is seen gets many points
ENOUGH = 20  # so many boxes without a single point are no coincidence
MARGIN_M = 0.1
FOOT_M = 0.3  # points this low in a box may be of the road


def collect(
    scene: CarlaScene,
    placements: Mapping[str, Placement],
    out: Path,
    report: Report = lambda line: None,
    connected: Callable[[CarlaScene], Any] = connect,
) -> BoxLog:
    """Collect what is missing in `out` from a running server; one process a folder.

    Placements by name may be none, and others may be added in a later call. `report` receives one
    line per route and what was left out; `connected` makes the client. Raises, besides what that
    does, ValueError: `out` holds another scene, or another placement of a name, a LiDAR has what
    none of CARLA's has, or the server lacks a map, blueprint or room; TimeoutError: a LiDAR does
    not deliver; RuntimeError: the server failed."""
    for name, placement in placements.items():
        for lidar in placement.lidars:
            check_possible(lidar, f"placement {name!r}: lidar")
        if not name or Path(name).name != name or name.startswith("."):
            raise InputError(place="placements", expected="names of folders", found=repr(name))
    # Where the server is does not decide what is seen.
    elsewhere = {"host", "port", "traffic_manager_port", "timeout_s"}
    contents = {out / "scene.json": scene.model_dump(mode="json", exclude=elsewhere)}
    for name, placement in placements.items():
        contents[out / "clouds" / name / "placement.json"] = rig_record(placement)
    for path, content in contents.items():
        _check_same(path, content)

    routes = scene.plan()
    folders = [out / "routes" / route.name for route in routes]
    clouds_of = {name: [out / "clouds" / name / r.name for r in routes] for name in placements}
    # The table of frames is the last one that is written.
    log_there = (out / "frames.parquet").exists()
    if log_there and all(folder.exists() for folder in chain(folders, *clouds_of.values())):
        return read_box_log(out)
    client = connected(scene)
    for path, content in contents.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(content, indent=1) + "\n")

    for route, folder in zip(routes, folders, strict=True):
        if not folder.exists():
            traffic = drive(client, scene, route, report)
            with _whole(folder, out) as partial:
                traffic.write(partial)
            report(f"{route.name} {route.town}: {len(traffic.frames)} frames driven")
    log = join_logs([box_log(Traffic.read(folder)) for folder in folders])
    write_box_log(out, log)

    for name, placement in placements.items():
        for route, recorded, folder in zip(routes, folders, clouds_of[name], strict=True):
            if not folder.exists():
                traffic = Traffic.read(recorded)
                clouds = replay(client, scene, route, traffic, placement)
                _check_seen(traffic, clouds, route.name, report)
                with _whole(folder, out) as partial:
                    write_clouds(partial, clouds)
                report(f"{route.name} {route.town}: {len(clouds)} clouds of {name}")
    return log


def _check_same(path: Path, content: Mapping[str, object]) -> None:
    if not path.exists():
        return
    before = read_json(path)
    if not isinstance(before, dict):
        raise InputError(place=path, expected="keys and values", fix="take another folder")
    for key, value in json.loads(json.dumps(content)).items():  # as it comes back
        if before.get(key) != value:
            same, fix = f"{before.get(key)} as before", "take another folder or another name"
            raise InputError(place=path, key=key, expected=same, found=value, fix=fix)


def _check_seen(traffic: Traffic, clouds: PointClouds, route: str, report: Report) -> None:
    """Report models that the LiDARs never hit; raise RuntimeError if they hit nothing at all."""
    boxes = box_log(traffic).boxes
    number = boxes["object_id"].str.rsplit("-").str[-1].astype(int)
    models = number.map(traffic.actors.set_index("actor")["blueprint"])
    never, nothing = unhit(boxes, models, clouds)
    if nothing:
        raise RuntimeError(
            f"{route}: no point lies on any of the road users near the ego, so the server's LiDARs "
            "look through them; take another release of CARLA"
        )
    if never:
        report(f"{route}: near the ego, but never hit by a LiDAR: {', '.join(never)}")


def unhit(boxes: pd.DataFrame, models: pd.Series, clouds: PointClouds) -> tuple[list[str], bool]:
    """List models that were near `ENOUGH` times and never hit, sorted; and whether nothing was hit.

    `models` has the blueprint of each row of `boxes`, `clouds` are of their frames."""
    near, hit = Counter[str](), Counter[str]()
    index_of = {frame: i for i, frame in enumerate(clouds.frames.tolist())}
    close = np.hypot(boxes["x"], boxes["y"]) <= NEAR_M
    for frame, of_frame in boxes[close].assign(model=models).groupby("frame"):
        near.update(of_frame["model"])
        solid = of_frame[list(GEOMETRY)].to_numpy(np.float64, copy=True)
        solid[:, 2] += (FOOT_M + MARGIN_M) / 2
        solid[:, 3:6] += [2 * MARGIN_M, 2 * MARGIN_M, MARGIN_M - FOOT_M]
        hit.update(of_frame["model"][count_points(clouds[index_of[frame]], solid) > 0])
    never = sorted(model for model, count in near.items() if count >= ENOUGH and not hit[model])
    return never, near.total() >= ENOUGH and not hit.total()


@contextmanager
def _whole(folder: Path, out: Path) -> Iterator[Path]:
    """Make an empty folder to write to, which takes the place of `folder` at the end."""
    partial = out / "unfinished"
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    yield partial
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial.replace(folder)
