"""Frames with real clouds: cells of objects that were hit, and what became of simulated rays."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.clouds import read_clouds
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.recall.detection_curve import default_curves
from lidarplace.rigs.placement import Mount
from lidarplace.validation.fit import Thinning
from lidarplace.validation.simulation import SimulatedRig, sectors_of

FATES = ("in the box", "hidden", "passed beyond", "lost")
"""Fate of a real ray where a simulated one meets an object: it met the object, too; something
nearer that nobody labelled; something behind; or nothing came back."""

_NEAR_RAY = np.radians(0.35)  # a return so close to a simulated ray belongs to the same firing
_SKIN_M = 0.1  # a return so close to a box belongs to it


class Cloud(NamedTuple):
    """The real cloud of a frame."""

    frame: int
    points: NDArray[np.float32]  # x, y, z in the ego frame, metres, shape (n, 3)
    lidar: NDArray[np.uint8]  # number of the LiDAR of each in the rig, shape (n,)


def real_clouds(folder: Path, lidars: int, most: int) -> Iterator[Cloud]:
    """Read at most so many of the clouds that `convert --clouds` kept for a log, spread evenly.

    Clouds whose points are not split by as many LiDARs as the rig has are left out."""
    parts = [read_clouds(path.parent) for path in sorted(folder.glob("clouds/recorded/*/data.npy"))]
    places = [
        (part, n) for part in parts if part.counts.shape[1] == lidars for n in range(len(part))
    ]
    chosen = np.linspace(0, len(places) - 1, min(len(places), most)).round().astype(int)
    for clouds, index in (places[n] for n in chosen.tolist()):
        yield Cloud(int(clouds.frames[index]), clouds[index][:, :3], clouds.lidar(index))


class CellHits(NamedTuple):
    """Cells of the objects of a frame that each LiDAR hits."""

    rows: NDArray[np.int64]  # of the log's boxes, shape (objects,)
    real: list[NDArray[np.int64]]  # of every LiDAR a row (object, cell) for each cell
    shipped: list[NDArray[np.int64]]
    corrected: list[NDArray[np.int64]]
    fates: NDArray[np.int64]  # rays of the simulation by `FATES`, shape (objects, 4)


def compare_cloud(
    cloud: Cloud, simulated: SimulatedRig, thinning: Thinning, classes: NDArray[np.str_]
) -> CellHits:
    """Compare a real cloud with its simulation, which `thinning` corrects.

    `classes` are of the log's boxes."""
    rows, placement = simulated.surroundings.rows(cloud.frame), simulated.placement
    boxes = simulated.log.boxes[list(GEOMETRY)].to_numpy(np.float64)[rows]
    rays_of = simulated.object_rays(cloud.frame)
    factor, distance = thinning.fit.factors(classes)[rows], thinning.fit.distance or math.inf
    random, cell = np.random.default_rng(cloud.frame), default_curves().cell
    hits = CellHits(rows, [], [], [], np.zeros((len(rows), len(FATES)), np.int64))
    for number, (mount, lidar) in enumerate(zip(placement.mounts, placement.lidars, strict=True)):
        points = cloud.points[cloud.lidar == number].astype(np.float64)
        hits.real.append(_cells(*_inside(points, boxes), boxes, cell))
        ray, target, ranges = rays_of[number]
        directions = lidar.in_frame(cloud.frame).directions()[ray]
        rays = directions @ mount.rotation.T
        hit_points = mount.position + rays * ranges[:, None]
        hits.shipped.append(_cells(hit_points, target, boxes, cell))
        chance = factor[target] * np.exp(-ranges * (1.0 / distance))
        chance *= thinning.mask[number][sectors_of(directions)]
        returns = random.random(len(hit_points)) < chance
        hits.corrected.append(_cells(hit_points[returns], target[returns], boxes, cell))
        hits.fates[:] += _fates(points - mount.position, rays, ranges, target, boxes, mount)
    return hits


MARGIN_M = 1.0  # real points so near to a box are in its `Overlay`


class Overlay(NamedTuple):
    """Real and simulated points of an object, in the axes of its box, metres from its centre."""

    size: NDArray[np.float64]  # length, width, height
    origin: NDArray[np.float64]  # of the ego frame, shape (3,)
    real: NDArray[np.float64]  # within `MARGIN_M` of the box, shape (n, 3)
    simulated: NDArray[np.float64]  # as shipped, shape (m, 3)


def overlay_of(row: int, cloud: Cloud, simulated: SimulatedRig) -> Overlay:
    """Collect the points of the object in a row of the log's boxes; it is in the cloud's frame."""
    box = simulated.log.boxes[list(GEOMETRY)].to_numpy(np.float64)[row]
    (number,) = np.flatnonzero(simulated.surroundings.rows(cloud.frame) == row)
    hits, placement = [], simulated.placement
    views = zip(placement.mounts, placement.lidars, simulated.object_rays(cloud.frame), strict=True)
    for mount, lidar, (ray, target, ranges) in views:
        directions = lidar.in_frame(cloud.frame).directions()[ray] @ mount.rotation.T
        hits.append((mount.position + directions * ranges[:, None])[target == number])
    real = _local(cloud.points.astype(np.float64), box)
    real = real[(np.abs(real) <= box[3:6] / 2 + MARGIN_M).all(axis=1)]
    origin = _local(np.zeros((1, 3)), box)[0]
    return Overlay(box[3:6], origin, real, _local(np.concatenate(hits), box))


def _inside(
    points: NDArray[np.float64], boxes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Select points that are in boxes, and return them with the number of the box of each."""
    inside, owner = [np.empty((0, 3))], [np.empty(0, np.int64)]
    for number, box in enumerate(boxes):
        near = points[np.abs(points[:, :2] - box[:2]).max(axis=1) <= np.hypot(*box[3:5])]
        inside.append(near[(np.abs(_local(near, box)) <= box[3:6] / 2).all(axis=1)])
        owner.append(np.full(len(inside[-1]), number))
    return np.concatenate(inside), np.concatenate(owner)


def _local(points: NDArray[np.float64], box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert points to the frames of their boxes; one box, or one for each point."""
    box = np.atleast_2d(box)
    x, y, z = (points - box[:, :3]).T
    c, s = np.cos(box[:, 6]), np.sin(box[:, 6])
    return np.stack([c * x + s * y, c * y - s * x, z], axis=1)


def _cells(
    points: NDArray[np.float64], owner: NDArray[np.integer], boxes: NDArray[np.float64], cell: float
) -> NDArray[np.int64]:
    if not len(points):
        return np.empty((0, 2), np.int64)
    box = boxes[owner]
    slices = np.maximum(np.ceil(box[:, 3:6] / cell - 1e-9), 1).astype(np.int64)
    place = np.floor((_local(points, box) + box[:, 3:6] / 2) / cell).astype(np.int64)
    place = np.clip(place, 0, slices - 1)
    number = (place[:, 0] * slices[:, 1] + place[:, 1]) * slices[:, 2] + place[:, 2]
    return np.unique(np.stack([owner.astype(np.int64), number], axis=1), axis=0)


def _fates(
    returns: NDArray[np.float64],
    rays: NDArray[np.float64],
    ranges: NDArray[np.float64],
    target: NDArray[np.int64],
    boxes: NDArray[np.float64],
    mount: Mount,
) -> NDArray[np.int64]:
    """Count the simulated `rays` on each object by `FATES`, shape (objects, 4).

    Real `returns` are relative to the LiDAR, in the axes of the ego frame."""
    from scipy.spatial import cKDTree

    fates = np.zeros((len(boxes), len(FATES)), np.int64)
    if not len(rays):
        return fates
    fate = np.full(len(rays), FATES.index("lost"))
    far = np.linalg.norm(returns, axis=1)
    returns, far = returns[far > 0], far[far > 0]
    if len(returns):
        away, nearest = cKDTree(returns / far[:, None]).query(rays, distance_upper_bound=_NEAR_RAY)
        met = np.isfinite(away)
        real = returns[nearest[met]] + mount.position
        box = boxes[target[met]]
        inside = (np.abs(_local(real, box)) <= box[:, 3:6] / 2 + _SKIN_M).all(axis=1)
        nearer = far[nearest[met]] < ranges[met]
        fate[met] = np.where(inside, 0, np.where(nearer, 1, 2))
    np.add.at(fates, (target, fate), 1)
    return fates
