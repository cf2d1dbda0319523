"""Predictors of other groups against what their papers state, and against brute force."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from lidarplace import PAPER_PLACEMENTS
from sweeps.benchmark.rigs import log_of

sys.path.insert(0, str(Path(__file__).parents[1] / "studies" / "findings"))
from peers.expected_ap import average_precision, both_sides, one_side
from peers.ground_points import density, nuc
from peers.perception_entropy import entropy

sys.path.pop(0)


def test_perception_entropy_of_one_object():
    # AP of 5 points by the paper's fit, by hand; none at all, and more than a perfect AP takes.
    ap = 0.152 * math.log(5) + 0.659
    expected = 2 * math.log(1 / ap - 1) + 1 + math.log(2 * math.pi)
    assert entropy([5]) == pytest.approx([expected])
    assert entropy([0]) == pytest.approx([2 * math.log(999) + 1 + math.log(2 * math.pi)])
    assert entropy([10**6]) == entropy([10**5]) == pytest.approx(entropy([50]))
    assert (np.diff(entropy(np.arange(10))) < 0).all()


def iou_of_extents(x, y):
    """IoU of a box of sizes x and y with one of 1 and 1 that shares a corner."""
    inner = np.minimum(x, 1) * np.minimum(y, 1)
    return inner / (x * y + 1 - inner)


def extents(random, n, least):
    """Draws of a density of 1 / extent^n from `least`, at least 0.5, to 2, by rejection."""
    least = max(least, 0.5)
    draws = random.uniform(least, 2, 400_000)
    return draws[random.uniform(size=len(draws)) < (least / draws) ** n]


@pytest.mark.parametrize("iou", [0.5, 0.7])
@pytest.mark.parametrize(
    ("n", "m", "across", "along"), [(1, 1, 0.3, 0.2), (2, 1, 0.9, 0.7), (4, 3, 0.8, 1.0)]
)
def test_two_sides_by_draws(n, m, across, along, iou):
    random = np.random.default_rng(0)
    x, y = extents(random, n, across), extents(random, m, along)
    size = min(len(x), len(y))
    expected = (iou_of_extents(x[:size], y[:size]) > iou).mean()

    value = both_sides(*(np.array([float(one)]) for one in (n, m, across, along, iou)))

    assert value == pytest.approx([expected], abs=0.01)


@pytest.mark.parametrize(("n", "first", "last"), [(2, 0.1, 0.8), (5, 0.0, 0.95), (3, 0.5, 0.7)])
def test_one_side_by_draws(n, first, last):
    random = np.random.default_rng(0)
    w, centre = extents(random, n, last - first), (first + last) / 2
    x = random.uniform(0.5, 2, len(w))
    inner = (np.minimum(centre + w / 2, 1) - np.maximum(centre - w / 2, 0)) * np.minimum(x, 1)
    expected = (inner / (x * w + 1 - inner) > 0.5).mean()

    value = one_side(*(np.array([float(one)]) for one in (n, first, last, 0.5)))

    assert value == pytest.approx([expected], abs=0.01)


def test_objects_with_more_points_come_first():
    assert average_precision(np.ones(5), np.arange(5.0)) == pytest.approx(1.0)
    assert average_precision(np.zeros(5), np.arange(5.0)) == pytest.approx(1 / 40 * 0)
    # Two of four, seen first: precision 1 up to half of the objects.
    detected, points = np.array([0.0, 1.0, 0.0, 1.0]), np.array([1.0, 5.0, 2.0, 9.0])
    recalls = np.linspace(0, 1, 40)
    assert average_precision(detected, points) == pytest.approx((recalls <= 0.5).mean())


def test_uniformity_by_counting():
    random = np.random.default_rng(1)
    points = random.uniform(0, 10, (300, 2))
    inside = (np.linalg.norm(points[:, None] - points[None], axis=2) <= 0.7).sum(axis=1)
    share = inside / (300 * math.pi * 0.7**2 / 100)
    assert nuc(points, 100.0) == pytest.approx(math.sqrt(((share - share.mean()) ** 2).mean()))
    assert nuc(np.empty((0, 2)), 100.0) == 0.0
    grid = np.stack(np.meshgrid(np.arange(0, 10, 0.1), np.arange(0, 10, 0.1)), -1).reshape(-1, 2)
    assert nuc(grid, 100.0) < nuc(points, 100.0)


def test_density_counts_the_ground_alone():
    rig = PAPER_PLACEMENTS["center"]
    assert density(rig, log_of("train")) == pytest.approx(density(rig, log_of("test")), rel=1e-2)
