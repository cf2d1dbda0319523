"""E-AP: expected AP from the extent and the number of points.

"Evaluating Roadside LiDAR Placement with a Probability-based Surrogate Metric", by its code
(anonymous-747/Roadside-LiDAR-Placement-Evaluation). Each three points on a side of an object count
as one; with n, its extent, in units of the true one, has a density of 1 / extent^n from the
farthest point (at least 0.5) to 2. An object is found as likely as the IoU of such a box exceeds
KITTI's threshold; those with more points come first. The paper takes points of the empty scene in
an object's shadow, this those on the object, by its cells, each on the nearer side in view.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.metrics import kitti_iou
from lidarplace.logs.box_log import BoxLog
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.recall.surface_cells import SurfaceCells, slices_of
from lidarplace.rigs.placement import Placement
from peers.seen_objects import by_class, seen_objects

CORRELATED, LEAST, MOST = 3, 0.5, 2.0
_STEPS = (np.arange(256) + 0.5) / 256

Array = NDArray[np.float64]


def expected_ap(placement: Placement, log: BoxLog) -> dict[str, float]:
    """E-AP of every class and of all objects, in [0, 1]."""
    objects, seen = seen_objects(placement, log)
    table = objects.table[["class"]].reset_index(drop=True)
    iou = table["class"].map(lambda name: kitti_iou(name).strict).to_numpy(np.float64)
    table["found"], table["points"] = _found(objects, seen, iou)
    return by_class(
        table, lambda own: average_precision(own["found"].to_numpy(), own["points"].to_numpy())
    )


def average_precision(found: Array, points: Array) -> float:
    """Mean precision at 40 recalls of objects found with a probability, most points first."""
    order = np.argsort(-points, kind="stable")
    hits = np.cumsum(found[order])
    recall, precision = hits / len(hits), hits / np.arange(1, len(hits) + 1)
    best = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    return float(best[np.searchsorted(recall, np.linspace(0, 1, 40))].mean())


def both_sides(n: Array, m: Array, across: Array, along: Array, iou: Array) -> Array:
    """Probability that a box is found by points on two sides of it; all of shape (objects,).

    There are n points on the short side, m on the long one, which reach a share of it, `across` and
    `along`, from the corner between the two.
    """
    t, x = iou[:, None], _quantile(n, across)
    with np.errstate(divide="ignore"):
        low = t / np.maximum(np.where(x > 1, 1 + t - t * x, x), 0.0)
    high = np.where(x > 1, 1 / (t * x), ((1 + t) * x - t) / (t * x))
    share = _cumulated(high, m, along) - _cumulated(low, m, along)
    return np.asarray(np.where(low < 1, np.maximum(share, 0.0), 0.0).mean(axis=1))


def one_side(n: Array, first: Array, last: Array, iou: Array) -> Array:
    """The same of points on one side alone, between two shares of it; nothing is known across."""
    t, reach = iou[:, None], np.maximum(last - first, LEAST)[:, None]
    middle = ((first + last) / 2)[:, None]
    uniform = reach + (MOST - reach) * _STEPS
    single = n[:, None] == 1
    w = np.where(single, uniform, _quantile(n, last - first))
    overlap = np.minimum(middle + w / 2, 1.0) - np.maximum(middle - w / 2, 0.0)
    rest = (1 + t) * overlap - t * w
    low = np.maximum(t / np.maximum(rest, 1e-12), LEAST)
    high = np.minimum(((1 + t) * overlap - t) / (t * w), MOST)
    share = np.where(rest > t, np.maximum(high - low, 0.0), 0.0) / (MOST - LEAST)
    # As published, the density of a single point is that of a whole range whatever it bounds.
    weight = np.where(single, (MOST - reach) / (MOST - LEAST), 1.0)
    return np.asarray((share * weight).mean(axis=1))


def _found(objects: CountedObjects, seen: SurfaceCells, iou: Array) -> tuple[Array, Array]:
    """Probability that each object is found, and the points that its place in the curve is by."""
    geometry, counts = objects.geometry, seen.counts()
    slices, owner = slices_of(geometry, objects.cell), np.repeat(np.arange(len(counts)), counts)
    along = seen.cells.astype(np.int64) // slices[owner, 2]  # without their height
    index = np.stack([along // slices[owner, 1], along % slices[owner, 1]], axis=1)
    x, y, c, s = *geometry[:, :2].T, np.cos(geometry[:, 6]), np.sin(geometry[:, 6])
    ego = np.stack([-(c * x + s * y), s * x - c * y], axis=1)[owner]  # from the object
    size = np.maximum(geometry[owner, 3:5], 1e-9)
    place = np.clip((index + 0.5) * objects.cell / size, 0.0, 1.0)
    place = np.where(ego > 0, 1 - place, place)  # from the corner that faces the vehicle
    faces = np.abs(ego) > size / 2
    nearer = place[:, 0] * size[:, 0] < place[:, 1] * size[:, 1]
    of_short = np.where(faces.all(axis=1), nearer, faces[:, 0])
    number, first, last = (np.full((2, len(counts)), start) for start in (0.0, 1.0, 0.0))
    for side, (mask, axis) in enumerate(((of_short, 1), (~of_short, 0))):
        share = np.bincount(owner[mask], minlength=len(counts)) / np.maximum(counts, 1)
        number[side] = np.ceil(seen.points * share / CORRELATED)
        np.minimum.at(first[side], owner[mask], place[mask, axis])
        np.maximum.at(last[side], owner[mask], place[mask, axis])
    found, has = np.zeros(len(counts)), number > 0
    two = has.all(axis=0)
    (n, m), (across, deep) = number[:, two], last[:, two]
    found[two] = both_sides(n, m, across, deep, iou[two])
    for side in range(2):
        own = has[side] & ~two
        found[own] = one_side(number[side, own], first[side, own], last[side, own], iou[own])
    return found, number.sum(axis=0)


def _quantile(n: Array, least: Array) -> Array:
    """Extents at the quantiles `_STEPS` of a density of 1 / extent^n, shape (objects, steps)."""
    low, power = np.clip(least, LEAST, MOST)[:, None], n[:, None] - 1
    with np.errstate(divide="ignore"):
        tail = (1 - _STEPS * (1 - (low / MOST) ** power)) ** (-1 / power)
    return np.asarray(low * np.where(power > 0, tail, (MOST / low) ** _STEPS))


def _cumulated(extent: Array, n: Array, least: Array) -> Array:
    """Probability of at most `extent`, shape (objects, steps)."""
    low, power = np.clip(least, LEAST, MOST)[:, None], n[:, None] - 1
    x = np.clip(extent, low, MOST)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (1 - (low / x) ** power) / (1 - (low / MOST) ** power)
        return np.asarray(np.where(power > 0, share, np.log(x / low) / np.log(MOST / low)))
