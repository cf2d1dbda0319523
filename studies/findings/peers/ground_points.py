"""Density and uniformity of the points on the ground (Cai et al., 2022, arXiv 2211.15975).

Both are of a scan of the empty scene: points per square metre, and NUC (normalised uniformity
coefficient), the standard deviation over discs around points of n / (N p), n the points in a disc,
N all of them, p its share of the area; discs as in PJLab-ADG/PCSim, ComputeDNUC.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidarplace.clouds.collect import collect, crop_for
from lidarplace.logs.box_log import BoxLog
from lidarplace.rigs.placement import Placement
from peers.seen_objects import ROI

DISCS, RADIUS_M = 6000, 0.7


AREA = (ROI.x[1] - ROI.x[0]) * (ROI.y[1] - ROI.y[0])


def density(placement: Placement, log: BoxLog) -> float:
    """Points on the ground of the ROI, per square metre."""
    return len(_ground(placement, log)) / AREA


def uniformity(placement: Placement, log: BoxLog) -> float:
    """NUC with the other sign: high where points are spread evenly."""
    return -nuc(_ground(placement, log), AREA)


def nuc(points: NDArray[np.float64], area: float) -> float:
    """NUC of points on `area` square metres, shape (n, 2); 0 without points."""
    if not len(points):
        return 0.0
    chosen = np.random.default_rng(0).choice(len(points), min(DISCS, len(points)), replace=False)
    tree = cKDTree(points)
    number = tree.query_ball_point(points[chosen], RADIUS_M, return_length=True)
    return float(np.std(number / (len(points) * math.pi * RADIUS_M**2 / area)))


def _ground(placement: Placement, log: BoxLog) -> NDArray[np.float64]:
    """x and y of what the rig sees of the ground where nothing else is."""
    empty = BoxLog(log.boxes.iloc[:0], log.frames)
    first = log.frames["frame"].to_numpy()[:1]
    crop = crop_for(ROI.x, ROI.y, ROI.z, placement)
    return collect(empty, first, placement, crop, seed=1)[0][:, :2].astype(np.float64)
