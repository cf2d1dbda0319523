"""Boxes under the ground and above it, and set on it."""

import math

import numpy as np
import pandas as pd
from hypothesis import given
from hypothesis import strategies as st

from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.ground_level import levelled, off_ground, undersides


def log_of(rows):
    """Boxes 1.6 m high of rows frame, x, y, underside; even frames are train."""
    boxes = pd.DataFrame(rows, columns=["frame", "x", "y", "z"])
    boxes = boxes.assign(z=boxes["z"] + 0.8, height=1.6, length=4.0, width=1.8, yaw=0.0)
    boxes = boxes.assign(scene="a", timestamp_s=0.0, object_id="1", **{"class": "Car"})
    frames = pd.DataFrame({"frame": range(4), "scene": "a", "timestamp_s": 0.0, "route": 0})
    return BoxLog(boxes, frames.assign(split=["train", "test"] * 2))


def test_boxes_off_the_ground_are_counted_by_split():
    rows = [(0, 5, 0, 0.0), (0, 9, 0, -0.29), (0, 9, 0, -0.9), (2, 9, 0, 0.4), (1, 9, 0, -0.4)]
    found = off_ground(log_of(rows)).set_index("split")
    assert found.loc["train"].to_dict() == {"boxes": 4, "buried": 1, "below": 1, "above": 1}
    assert found.loc["test"].to_dict() == {"boxes": 1, "buried": 0, "below": 1, "above": 0}
    assert off_ground(log_of(rows[:0])).empty


@given(
    slope=st.floats(-0.03, 0.03),
    height=st.floats(-3, 3),
    turn=st.floats(0, math.tau),
    step=st.floats(2, 7),
)
def test_on_an_even_slope_all_boxes_come_near_the_ground(slope, height, turn, step):
    """The boxes of a road that climbs: at its ends the median is of one side."""
    along = step * np.arange(-6, 7)
    x, y = along * math.cos(turn), along * math.sin(turn)
    log, _ = levelled(log_of([(0, *row) for row in zip(x, y, height + slope * along, strict=True)]))
    assert np.abs(undersides(log.boxes)).max() <= 3 * abs(slope) * step + 1e-9
    assert np.abs(undersides(log.boxes)[3:-3]).max() < 1e-9


def test_a_box_above_its_neighbours_stays_above_them():
    rows = [(0, x, 0, -1.0) for x in range(0, 20, 4)] + [(0, 8, 3, 1.0), (1, 8, 0, 2.5)]
    log, moved = levelled(log_of(rows))
    np.testing.assert_allclose(undersides(log.boxes), [0] * 5 + [2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(moved, [1.0] * 6 + [-2.5])
