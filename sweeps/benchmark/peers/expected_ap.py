"""E-AP: expected AP from the extent and the number of points.

"Evaluating Roadside LiDAR Placement with a Probability-based Surrogate Metric", by its code
(anonymous-747/Roadside-LiDAR-Placement-Evaluation).

The points on a side of an object bound its extent from below: with n of them, each three points
counted as one, the extent, in units of the true one, has a density proportional to 1 / extent^n
between the farthest point (at least 0.5) and 2. An object is found as likely as the IoU of the box
of such extents with the true one exceeds its threshold. Objects with more points come first in the
precision-recall curve.

In the paper points are those that the empty scene has in an object's shadow. Here they are those on
the object itself, by the cells that are hit; each is of the nearer of the sides that face the
vehicle. IoUs are KITTI's, as of the detectors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.metrics import kitti_iou
from lidarplace.logs.box_log import BoxLog
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.recall.surface_cells import SurfaceCells, slices_of
from lidarplace.rigs.placement import Placement
from sweeps.benchmark.peers.seen_objects import by_class, seen_objects

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
    """Mean precision at 40 recalls of objects that are found with a probability, most points
    first."""
    order = np.argsort(-points, kind="stable")
    hits = np.cumsum(found[order])
    recall, precision = hits / len(hits), hits / np.arange(1, len(hits) + 1)
    best = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    return float(best[np.searchsorted(recall, np.linspace(0, 1, 40))].mean())


def both_sides(n: Array, m: Array, across: Array, along: Array, iou: Array) -> Array:
    """Probability that a box is found by points on two sides of it; all of shape (objects,).

    Args:
        n, m: points on the short and on the long side, at least 1.
        across, along: how far they reach from the corner between the two, share of the side.
        iou: that the box must exceed.
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
    slices = slices_of(geometry, objects.cell)
    owner = np.repeat(np.arange(len(counts)), counts)
    cells, sizes = seen.cells.astype(np.int64), slices[owner]
    index = np.stack([cells // (sizes[:, 1] * sizes[:, 2]), cells // sizes[:, 2] % sizes[:, 1]], 1)
    c, s = np.cos(geometry[:, 6]), np.sin(geometry[:, 6])
    x, y = geometry[:, 0], geometry[:, 1]
    ego = np.stack([-(c * x + s * y), s * x - c * y], axis=1)  # the vehicle, from the object
    size = np.maximum(geometry[:, 3:5], 1e-9)
    place = np.clip((index + 0.5) * objects.cell / size[owner], 0.0, 1.0)
    place = np.where(ego[owner] > 0, 1 - place, place)  # from the corner that faces the vehicle
    faces = np.abs(ego)[owner] > size[owner] / 2
    of_short = np.where(
        faces.all(axis=1), place[:, 0] * size[owner, 0] < place[:, 1] * size[owner, 1], faces[:, 0]
    )
    number, first, last = np.zeros((2, len(counts))), *np.zeros((2, 2, len(counts)))
    for side, (mask, axis) in enumerate(((of_short, 1), (~of_short, 0))):
        at, own = place[mask, axis], owner[mask]
        share = np.bincount(own, minlength=len(counts)) / np.maximum(counts, 1)
        number[side] = np.ceil(seen.points * share / CORRELATED)
        first[side] = 1.0
        np.minimum.at(first[side], own, at)
        np.maximum.at(last[side], own, at)
    found, has = np.zeros(len(counts)), number > 0
    two = has.all(axis=0)
    (n, m), (across, along) = number[:, two], last[:, two]
    found[two] = both_sides(n, m, across, along, iou[two])
    for side in range(2):
        alone = has[side] & ~has[1 - side]
        found[alone] = one_side(
            number[side, alone], first[side, alone], last[side, alone], iou[alone]
        )
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
