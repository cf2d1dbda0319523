"""Implausible values of a box log: unit of yaw, heading of the vehicle, whole numbers."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.logs.boxes import POSE_COLUMNS
from lidarplace.scenes.sanity_checks.boxes import (
    implausible_degrees,
    implausible_surroundings,
    implausible_units,
)
from lidarplace.scenes.sanity_checks.copies import copied_test_frames
from lidarplace.scenes.sanity_checks.motion import implausible_motion, implausible_poses
from tests.lidarplace.company_table import traffic


def with_yaw(log, yaw):
    return replace(log, boxes=log.boxes.assign(yaw=yaw))


def without_poses(log):
    return replace(log, frames=log.frames.drop(columns=list(POSE_COLUMNS)))


@pytest.mark.parametrize("poses", [True, False])
@pytest.mark.parametrize("straight", [True, False])
def test_motion_shows_the_unit_of_yaw(poses, straight):
    """Degrees of a straight road are as small as radians; what moves along it tells them apart."""
    log = traffic(5, objects=9, straight=straight)
    log = log if poses else without_poses(log)
    assert list(implausible_motion(log)) == []
    yaw = log.boxes["yaw"]
    small = np.degrees(np.remainder(yaw + math.pi / 2, math.pi) - math.pi / 2)
    if straight:
        assert small.abs().max() < math.pi
        assert list(implausible_units(with_yaw(log, small))) == []
    (value,) = implausible_motion(with_yaw(log, small))
    assert value.remedy == "units.angle (yaw in deg)"
    assert not value.rows[log.boxes["class"] == "Pedestrian"].any()
    if not straight:
        (value,) = implausible_motion(with_yaw(log, np.radians(yaw)))
        assert value.remedy == "units.angle (yaw in rad)"


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_random_yaw_shows_no_unit(seed):
    log = traffic(3, objects=9)
    random = np.random.default_rng(seed).uniform(-math.pi, math.pi, len(log.boxes))
    assert list(implausible_motion(with_yaw(log, random))) == []


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), turn=st.floats(-3.1, 3.1))
def test_a_vehicle_drives_where_it_heads(seed, turn):
    log = traffic(seed)
    assert list(implausible_poses(log)) == []
    assert list(implausible_poses(without_poses(log))) == []
    turned = log.frames.assign(ego_yaw=log.frames["ego_yaw"] + turn)
    shuffled = replace(log, frames=turned.sample(frac=1, random_state=seed, ignore_index=True))
    values = list(implausible_poses(shuffled))
    if abs(turn) < 0.27:
        assert values == []
    elif abs(turn) > 0.34:
        (value,) = values
        assert value.rows.sum() == 21
        assert "21 of 24 frames (87.5 %)" in value.where(shuffled.frames)


def test_routes_in_which_nothing_moves_are_no_copies():
    log = traffic()
    first = log.boxes[log.boxes["frame"] == 0]
    still = pd.concat([first.assign(frame=n) for n in log.frames["frame"]], ignore_index=True)
    assert list(copied_test_frames(log, log)) == []
    assert list(copied_test_frames(replace(log, boxes=still), replace(log, boxes=still))) == []


def test_whole_numbers_are_degrees():
    log = traffic()
    yaw = np.zeros(len(log.boxes))
    yaw[:3] = 2, -1, 3
    (value,) = implausible_units(with_yaw(log, yaw))
    where = value.where(with_yaw(log, yaw).boxes)
    assert where == "3 of 144 boxes (2.1 %), the first in frame 0 with 2"
    yaw[2] = 3.1
    assert list(implausible_units(with_yaw(log, yaw))) == []


def test_a_correct_log_and_an_empty_one_are_plausible():
    for log in (traffic(), replace(traffic(), boxes=traffic().boxes[:0])):
        for doubts in (
            implausible_units(log),
            implausible_degrees(log),
            implausible_surroundings(log),
        ):
            assert list(doubts) == []
        assert list(implausible_motion(log)) == []
