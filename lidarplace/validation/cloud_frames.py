"""Frames with real clouds: cells of objects that were hit, and what became of simulated rays."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.clouds import read_clouds
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.placement import Mount
from lidarplace.validation.simulation import Recording, sectors_of

FATES = ("in the box", "hidden", "passed beyond", "lost")
"""What a real LiDAR did where a simulated ray meets an object: it met the object, too; something
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
    place = [(own, n) for own in parts if own.counts.shape[1] == lidars for n in range(len(own))]
    chosen = np.linspace(0, len(place) - 1, min(len(place), most)).round().astype(int)
    for clouds, index in (place[n] for n in chosen.tolist()):
        yield Cloud(int(clouds.frames[index]), clouds[index][:, :3], clouds.lidar(index))


class Seen(NamedTuple):
    """Cells of the objects of a frame that each LiDAR hits."""

    rows: NDArray[np.int64]  # of the log's boxes, shape (objects,)
    real: list[NDArray[np.int64]]  # of every LiDAR a row (object, cell) for each cell
    shipped: list[NDArray[np.int64]]
    corrected: list[NDArray[np.int64]]
    fates: NDArray[np.int64]  # rays of the simulation by `FATES`, shape (objects, 4)


def seen_in(
    cloud: Cloud,
    recording: Recording,
    share: NDArray[np.float64],
    factor: NDArray[np.float64],
    loss: float,
    cell: float,
) -> Seen:
    """Compare a real cloud with its simulation.

    `correction` thins simulated rays; `cell` is the edge of a cell, metres."""
    rows, placement = recording.surroundings.rows(cloud.frame), recording.placement
    boxes = recording.log.boxes[list(GEOMETRY)].to_numpy(np.float64)[rows]
    every = recording.met(cloud.frame)
    random = np.random.default_rng(cloud.frame)
    found = Seen(rows, [], [], [], np.zeros((len(rows), len(FATES)), np.int64))
    for number, (mount, lidar) in enumerate(zip(placement.mounts, placement.lidars, strict=True)):
        points = cloud.points[cloud.lidar == number].astype(np.float64)
        found.real.append(_cells(*_inside(points, boxes), boxes, cell))
        met = every[number]
        directions, target = lidar.in_frame(cloud.frame).directions()[met.ray], met.target
        rays = directions @ mount.rotation.T
        at = mount.position + rays * met.range[:, None]
        found.shipped.append(_cells(at, target, boxes, cell))
        chance = factor[rows][target] * np.exp(-met.range * loss)
        chance *= share[number][sectors_of(directions)]
        kept = random.random(len(at)) < chance
        found.corrected.append(_cells(at[kept], target[kept], boxes, cell))
        found.fates[:] += _fates(points - mount.position, rays, met.range, target, boxes, mount)
    return found


def _inside(
    points: NDArray[np.float64], boxes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Select points that are in boxes, and return them with the number of the box of each."""
    at, owner = [np.empty((0, 3))], [np.empty(0, np.int64)]
    for number, box in enumerate(boxes):
        near = points[np.abs(points[:, :2] - box[:2]).max(axis=1) <= np.hypot(*box[3:5])]
        own = near[(np.abs(_local(near, box)) <= box[3:6] / 2).all(axis=1)]
        at.append(own)
        owner.append(np.full(len(own), number))
    return np.concatenate(at), np.concatenate(owner)


def _local(points: NDArray[np.float64], box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert points to the frames of their boxes; one box, or one for each point."""
    box = np.atleast_2d(box)
    x, y, z = (points - box[:, :3]).T
    c, s = np.cos(box[:, 6]), np.sin(box[:, 6])
    return np.stack([c * x + s * y, c * y - s * x, z], axis=1)


def _cells(
    points: NDArray[np.float64], owner: NDArray[np.integer], boxes: NDArray[np.float64], cell: float
) -> NDArray[np.int64]:
    """Return distinct (object, cell), shape (n, 2)."""
    if not len(points):
        return np.empty((0, 2), np.int64)
    own = boxes[owner]
    slices = np.maximum(np.ceil(own[:, 3:6] / cell - 1e-9), 1).astype(np.int64)
    place = np.floor((_local(points, own) + own[:, 3:6] / 2) / cell).astype(np.int64)
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
        own = boxes[target[met]]
        inside = (np.abs(_local(real, own)) <= own[:, 3:6] / 2 + _SKIN_M).all(axis=1)
        nearer = far[nearest[met]] < ranges[met]
        fate[met] = np.where(inside, 0, np.where(nearer, 1, 2))
    np.add.at(fates, (target, fate), 1)
    return fates
