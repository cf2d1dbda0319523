"""Distances between the LiDARs of a placement."""

import math

import pytest

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement
from lidarplace.mounting.spacing import least_distance


def test_least_distance():
    mounts = [Mount(0, 0, 1), Mount(3, 0, 1), Mount(3, 0.3, 1.4), Mount(-4, 0, 1)]
    assert least_distance(Placement("p", mounts, Lidar.paper())) == pytest.approx(0.5)
    assert least_distance(PAPER_PLACEMENTS["line"]) == pytest.approx(0.2)
    assert least_distance(Placement("p", mounts[:1], Lidar.paper())) == math.inf
