"""Points on the objects of Argoverse 2, recorded and simulated with and without time for a turn.

    lidarplace convert argoverse data/argoverse2 logs/av2 --clouds data/argoverse2 --keep-ignored
    python benchmarks/studies/argoverse_turn.py data/argoverse2 logs/av2

`data/argoverse2` is that of `argoverse_logs.py`. Directions and phases of the two LiDARs, which
turn at 10 Hz, are those of the time offsets of the points in the sweeps. `whole frame`: labels are
at the beginning of the sweep, as are the stamps of the data set; `middle`: in the middle of it.

Prints of the objects nearer than 75 m, by speed: the median of simulated over recorded points, the
median abs log2, and the share within a factor 2, with 95 % intervals of the paired differences from
a still world, of 500 bootstraps over tracks."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.clouds.moving import Motion, Scan, cast_moving, part_motion, poses_at
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.logs.box_log import read_box_log
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.logs.motion import motion_in
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.validation.simulation import SimulatedRig, rays_on_objects
from lidarplace.validation.validation import object_table, rig_and_counted_log

UP = 1000.0  # above flat ground, which labels of these logs do not know, metres
KINDS = ("still", "whole frame", "middle")
SPEEDS = {"all": 0.0, "above 5 m/s": 5.0, "above 10 m/s": 10.0}


def scans(data: Path, rig: RecordedRig) -> list[tuple[float, float, float]]:
    """Direction, azimuth at the stamp of a sweep, and first moment of each LiDAR of the rig."""
    path = next(data.glob("val/*/sensors/lidar/*.feather"))
    sweep, scans = pd.read_feather(path), []
    for number, mount in enumerate(rig.placement.mounts):
        points = sweep[sweep["laser_number"] // 32 == number]
        x, y, _ = ((points[["x", "y", "z"]].to_numpy(float) - mount.position) @ mount.rotation).T
        t = points["offset_ns"].to_numpy(float) * 1e-9
        far, turn = np.hypot(x, y) > 5, np.arctan2(y, x)
        means = {s: np.exp(1j * (turn - s * 20 * math.pi * t))[far].mean() for s in (1.0, -1.0)}
        sign = max(means, key=lambda s: abs(means[s]))
        scans.append((sign, float(np.angle(means[sign])), float(t.min())))
        direction, angle = "left" if sign > 0 else "right", math.degrees(scans[-1][1])
        print(f"{rig.names[number]}: {direction}, at {angle:.0f} degrees at the stamp")
    return scans


def counted(data: Path, folder: Path) -> pd.DataFrame:
    """Simulated points in each box, of a still world and of both kinds of moments."""
    rig, log = rig_and_counted_log(read_box_log(folder), folder)
    surroundings, motion = SimulatedRig(log, rig.placement).surroundings, motion_in(log)
    boxes, frames = log.boxes[list(GEOMETRY)].to_numpy(float), log.frames["frame"].to_numpy()
    views = list(zip(rig.placement.mounts, rig.placement.lidars, scans(data, rig),
                     ends_in_rig(rig.placement, None), strict=True))  # fmt: skip
    columns = {kind: np.zeros(len(boxes)) for kind in KINDS}
    for index, frame in enumerate(frames.tolist()):
        rows, parts = surroundings.rows(frame), surroundings.parts(frame, 300.0)
        parts = body_parts(None).and_(parts)
        rates = part_motion(parts, boxes[rows, :2], motion.boxes[rows])
        moving = Motion(motion.frames[index], rates)
        high = replace(parts, geometry=parts.geometry + UP * (np.arange(10) == 2))
        for mount, lidar, (sign, azimuth, start), ends in views:
            rays = rays_on_objects(mount, lidar, parts, None, ends)
            columns["still"] += np.bincount(rows[rays.target], minlength=len(boxes))
            share = (sign * (lidar.azimuths() - azimuth) / (2 * math.pi) - start * 10) % 1.0
            for kind, first in zip(KINDS[1:], (start, -0.05), strict=True):
                moments = (first + share / 10)[None]
                raised = replace(mount, z=mount.z + UP)
                hits = cast_moving(raised, lidar, high, moving, Scan.at(moments), ends=ends)
                (ray,) = np.nonzero(hits.target >= 0)
                away = hits.range[ray]
                seen = (away >= lidar.min_range) & (away <= lidar.sight(hits.reflected[ray]))
                ray, away = ray[seen], away[seen, None]
                x, y, _ = (mount.position + (lidar.directions()[ray] @ mount.rotation.T) * away).T
                pose = poses_at(moments, moving.ego)[0][:, ray % lidar.fired_steps]
                target = rows[hits.target[ray]]
                box = boxes[target]
                dx = pose[2] + pose[0] * x - pose[1] * y - box[:, 0]
                dy = pose[3] + pose[1] * x + pose[0] * y - box[:, 1]
                c, s = np.cos(box[:, 6]), np.sin(box[:, 6])
                within = np.abs(c * dx + s * dy) <= box[:, 3] / 2
                within &= np.abs(c * dy - s * dx) <= box[:, 4] / 2
                columns[kind] += np.bincount(target[within], minlength=len(boxes))
    return object_table(log).assign(**columns, speed=np.hypot(*motion.boxes[:, :2].T))


def scores(objects: pd.DataFrame, kind: str) -> NDArray[np.float64]:
    """Median of the ratio, median abs log2, percentage within a factor 2."""
    some = objects[objects[kind] >= 5]
    ratio = np.log2((some[kind] + 0.5) / (some["real"] + 0.5))
    return np.array([2 ** ratio.median(), ratio.abs().median(), 100 * (ratio.abs() <= 1).mean()])


def main(data: Path, folder: Path) -> None:
    table = counted(data, folder)
    table = table[(table["distance"] < 75) & table["real"].notna()]
    for name, least in SPEEDS.items():
        some = table[table["speed"] >= least]
        tracks = [rows for _, rows in some.groupby(["scene", "object_id"])]
        random, draws = np.random.default_rng(0), []
        for _ in range(500):
            numbers = random.integers(len(tracks), size=len(tracks))
            drawn = pd.concat([tracks[n] for n in numbers])
            of_kinds = np.array([scores(drawn, kind) for kind in KINDS])
            draws.append(of_kinds - of_kinds[0])
        print(f"{name}: {len(some)} boxes, {len(tracks)} tracks")
        for kind, limits in zip(KINDS, np.percentile(draws, [2.5, 97.5], axis=0).transpose(1, 2, 0),
                                strict=True):  # fmt: skip
            ends = ", ".join(f"{low:+.2f} to {high:+.2f}" for low, high in limits)
            print(f"  {kind}: {scores(some, kind).round(3).tolist()}, differences {ends}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
