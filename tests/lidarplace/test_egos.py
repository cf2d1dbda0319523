"""Egos are chosen so that their frames hold many different road users."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.scenes.sumo.record import MEETS_M, choose_egos
from lidarplace.scenes.sumo.traffic import BICYCLE, CAR, PEDESTRIAN, RoadUser
from lidarplace.scenes.sumo.trajectories import Trajectories
from tests.refused import refused

STEPS = 5
FAR_M = 1000.0
"""Distance of places that see nothing of each other."""


def world(*users, speed=None) -> Trajectories:
    """Road users at x of every step, or at one x all the time, optionally (kind, x)."""
    kinds, places = [], []
    for user in users:
        kind, x = user if isinstance(user, tuple) else (CAR, user)
        kinds.append(kind)
        places.append(np.broadcast_to(np.asarray(x, np.float64), STEPS))
    pose = np.zeros((STEPS, len(users), 3))
    pose[:, :, 0] = np.transpose(places)
    named = [RoadUser(f"{kind.name}{u}", kind, 4.0, 2.0, 1.5) for u, kind in enumerate(kinds)]
    speeds = np.tile(np.array(speed or [9.0] * len(users)), (STEPS, 1))
    z = np.where(np.isnan(pose[:, :, 0]), np.nan, 0.0)
    return Trajectories(named, np.arange(STEPS, dtype=np.float64), pose, z, speeds)


def people(*x: float) -> list[tuple]:
    return [(PEDESTRIAN, place) for place in x]


def test_the_ego_meets_many_others_rather_than_a_few_all_the_time():
    jam = [0.0, 10.0, 20.0, 30.0]
    road = FAR_M + 25.0 * np.arange(STEPS)
    passing = people(*(FAR_M + MEETS_M / 2 + 25.0 * np.arange(STEPS)))
    traffic = world(*jam, road, *passing)
    assert choose_egos(traffic, 1) == [4]


def test_the_second_ego_is_where_the_first_is_not():
    first = [0.0, 5.0]
    there = people(10.0, 11.0, 12.0, 13.0)
    elsewhere = [FAR_M]
    fewer = people(FAR_M + 10.0, FAR_M + 11.0, FAR_M + 12.0)
    traffic = world(*first, *there, *elsewhere, *fewer)
    assert choose_egos(traffic, 2) == [0, 6]


def test_two_met_in_a_frame_each_are_better_than_one_met_in_two():
    away = [FAR_M / 2] * 4
    one_for_long = [0.0, (PEDESTRIAN, [10.0, 10.0, *away[1:]])]
    two_for_short = [FAR_M, (PEDESTRIAN, [FAR_M, *away]), (PEDESTRIAN, [*away, FAR_M])]
    traffic = world(*one_for_long, *two_for_short)
    assert choose_egos(traffic, 1) == [2]


def test_who_drives_comes_before_who_stands():
    there = people(10.0, 11.0, 12.0)
    traffic = world(0.0, *there, FAR_M, 2 * FAR_M, speed=[0.1, 1, 1, 1, 9.0, 9.0])
    assert choose_egos(traffic, 1) == [4]
    assert choose_egos(traffic, 2) == [4, 5]
    assert choose_egos(traffic, 3) == [0, 4, 5]


def test_only_cars_that_stayed_are_egos():
    nowhere = [0.0, 1.0, math.nan, 2.0, 3.0]
    put_elsewhere = [0.0, 1.0, 2.0, 300.0, 301.0]
    traffic = world((BICYCLE, 0.0), nowhere, put_elsewhere, *people(1.0), FAR_M)
    assert choose_egos(traffic, 1) == [4]
    with refused(("", "", "1")):
        choose_egos(traffic, 2)


def test_who_is_on_another_level_is_not_met():
    traffic = world(0.0, *people(10.0, 11.0), FAR_M, *people(FAR_M))
    traffic.z[:, 1:3] = 6.0
    assert choose_egos(traffic, 1) == [3]


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_each_ego_adds_most_to_those_before(seed):
    """The choice is greedy by the sum of ln(1 + frames met), counted from positions."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 300, (12, 1)) + rng.uniform(-30, 30, (12, 1)) * np.arange(STEPS)
    traffic = world(*places[:6], *people(*places[6:]))

    def value(egos) -> float:
        near = np.abs(places[:, None] - places[egos]) <= MEETS_M
        near[egos, range(len(egos))] = False
        return np.log1p(near.sum(axis=(1, 2))).sum()

    greedy = []
    for count in (1, 2, 3):
        chosen = choose_egos(traffic, count)
        (new,) = set(chosen) - set(greedy)
        others = [value([*greedy, car]) for car in range(6) if car not in greedy]
        assert value([*greedy, new]) == pytest.approx(max(others))
        greedy.append(new)
