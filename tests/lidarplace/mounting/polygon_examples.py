"""Polygons for tests, and what is inside of them by other means."""

import math

import numpy as np
from hypothesis import strategies as st

from lidarplace.mounting.polygon import polygon


@st.composite
def stars(draw):
    """A simple polygon, rarely convex: vertices at rising angles about a centre."""
    number = draw(st.integers(3, 9))
    # Gaps of less than half a turn keep the centre inside.
    gaps = np.array(draw(st.lists(st.floats(1, 1.9), min_size=number, max_size=number)))
    angles = np.cumsum(gaps / gaps.sum() * 2 * math.pi) + draw(st.floats(0, 6))
    radii = np.array(draw(st.lists(st.floats(0.1, 2), min_size=number, max_size=number)))
    centre = np.array([draw(st.floats(-2, 2)), draw(st.floats(-2, 2))])
    points = centre + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    turned = points[:: draw(st.sampled_from([1, -1]))]
    return polygon([(x, y) for x, y in turned])


@st.composite
def combs(draw):
    """Teeth of different lengths on a bar: sections across have many pieces."""
    teeth = draw(st.lists(st.integers(1, 4), min_size=1, max_size=4))
    points = [(-1, len(teeth) * 2 - 1), (-1, 0)]
    for i, length in enumerate(teeth):
        points += [(length, 2 * i), (length, 2 * i + 1), (0, 2 * i + 1), (0, 2 * i + 2)]
    points = points[:-2]  # the last tooth has no gap after it
    lift, scale = draw(st.floats(-6, 2)), draw(st.sampled_from([1.0, 0.1, 0.37]))
    return polygon([(x * scale, (y + lift) * scale) for x, y in points])


polygons = stars() | combs()


def counted_inside(vertices, x, y):
    """Even-odd rule along a slanted ray, with no code in common."""
    far = np.array([x + 1000.0, y + 613.7])
    a = np.array(vertices)
    b = np.roll(a, -1, axis=0)
    p, ray, edge = np.array([x, y]), far - np.array([x, y]), b - a
    denominator = ray[0] * edge[:, 1] - ray[1] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((a - p)[:, 0] * edge[:, 1] - (a - p)[:, 1] * edge[:, 0]) / denominator
        s = ((a - p)[:, 0] * ray[1] - (a - p)[:, 1] * ray[0]) / denominator
    return int(((t > 0) & (s >= 0) & (s < 1)).sum()) % 2 == 1


def away_from(vertices, x, y):
    """Distance of a point to the boundary."""
    a = np.array(vertices)
    edge = np.roll(a, -1, axis=0) - a
    p = np.array([x, y])
    share = np.clip(((p - a) * edge).sum(1) / (edge**2).sum(1), 0, 1)
    return float(np.hypot(*(a + share[:, None] * edge - p).T).min())


def some_points(vertices, seed, number=40):
    """Points around a polygon that are clearly inside or outside."""
    a = np.array(vertices)
    low, high = a.min(axis=0) - 0.3, a.max(axis=0) + 0.3
    points = np.random.default_rng(seed).uniform(low, high, (number, 2))
    return [(x, y) for x, y in points if away_from(vertices, x, y) > 1e-7]
