"""Edges of lanes in pictures: those of the ground that lanes cover."""

import numpy as np
import pytest

from lidarplace.viewing.lane_edges import lane_edges


def lines(*lanes) -> set[tuple[tuple[float, float], ...]]:
    """Edges as pairs of points, to the centimetre, the lower one first."""
    drawn = lane_edges(np.array(lanes, float).reshape(-1, 5)).reshape(-1, 3, 2)
    assert np.isnan(drawn[:, 2]).all()
    return {tuple(sorted(map(tuple, (np.round(edge[:2], 1) + 0.0).tolist()))) for edge in drawn}


def test_lanes_side_by_side_have_a_line_between_them_and_ends_in_a_lane_are_hidden():
    road = lines((0, 1, 0, 10, 1), (0, -1, np.pi, 10, 1))
    assert road == {
        *(((-10, y), (10, y)) for y in (-2, 0, 2)),
        *(((x, y), (x, y + 2)) for x in (-10, 10) for y in (-2, 0)),
    }
    one, crossing = (0, 0, 0, 10, 1), (0, 0, np.pi / 2, 10, 2)
    parts = {((-10, y), (-2, y)) for y in (-1, 1)} | {((2, y), (10, y)) for y in (-1, 1)}
    assert parts <= lines(one, crossing)
    assert not any(abs(x) < 2 and abs(y) < 1 for edge in lines(one, crossing) for x, y in edge)


def test_a_lane_is_turned_as_its_yaw():
    x, y = np.cos(0.3), np.sin(0.3)
    drawn = lane_edges(np.array([[5.0, 2.0, 0.3, 4.0, 1.0]])).reshape(-1, 3, 2)[:, :2] - [5, 2]
    local = drawn @ [[x, -y], [y, x]]
    assert np.abs(local).reshape(-1, 2) == pytest.approx(np.tile([4.0, 1.0], (8, 1)), abs=1e-5)
    assert lines() == set()
