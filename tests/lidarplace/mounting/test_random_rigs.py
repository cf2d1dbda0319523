"""Rigs at random around given ones: repeatable, varied, never too close, and their space."""

import math
from dataclasses import astuple, replace

from scipy.spatial.distance import pdist

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement
from lidarplace.mounting.random_rigs import outside, random_rigs
from lidarplace.mounting.ring_overlap import rings

EIGHT = list(PAPER_PLACEMENTS.values())


def test_the_same_seed_gives_the_same_rigs_and_another_one_others():
    first, again, other = (random_rigs(EIGHT, 6, seed) for seed in (1, 1, 2))
    assert first == again
    assert not {rig.mounts for rig in first} & {rig.mounts for rig in other}


def test_rigs_reach_from_rings_between_each_other_to_rings_that_coincide():
    drawn = random_rigs(EIGHT, 16, 0)
    shares = [rings(rig).redundancy for rig in drawn]
    assert shares == sorted(shares)
    assert shares[0] < 0.1
    assert shares[-1] > 0.35
    assert [rig.name for rig in drawn[:2]] == ["rig_01", "rig_02"]


def test_rigs_hold_plain_numbers_and_their_lidars_apart():
    for rig in random_rigs(EIGHT, 16, 3):
        assert all(type(value) is float for mount in rig.mounts for value in astuple(mount))
        assert pdist([mount.position for mount in rig.mounts]).min() >= 0.15


def test_every_rig_has_the_lidars_of_a_given_one():
    front = Lidar((0.0,), 600, azimuth=(-1.0, 1.0))
    mixed = [
        Placement("two", [Mount(x=2, z=0.6), Mount(z=2)], [front, Lidar.paper()]),
        Placement("three", [Mount(z=2), Mount(y=0.5, z=2), Mount(y=-0.5, z=2)], Lidar.paper()),
    ]
    drawn = random_rigs(mixed, 12, 0)
    assert {len(rig.mounts) for rig in drawn} == {2, 3}
    assert {rig.lidars for rig in drawn} == {rig.lidars for rig in mixed}


def test_the_given_rigs_are_in_the_space_of_those_drawn_and_others_are_not():
    drawn = random_rigs(EIGHT, 32, 1)
    assert [outside(rig, drawn) for rig in EIGHT] == [None] * 8
    high = replace(EIGHT[0], mounts=[replace(m, z=m.z + 3) for m in EIGHT[0].mounts])
    assert outside(high, drawn).startswith("z by ")
    tipped = replace(EIGHT[0], mounts=[replace(m, pitch=math.pi / 2) for m in EIGHT[0].mounts])
    assert outside(tipped, drawn).startswith("pitch by ")
    two = replace(EIGHT[0], mounts=EIGHT[0].mounts[:2])
    top = max(mount.z for rig in drawn for mount in rig.mounts)
    for beyond, text in ((0.09, None), (0.11, "z by 0.11 m")):
        mounts = [replace(EIGHT[0].mounts[0], z=top + beyond), *EIGHT[0].mounts[1:]]
        assert outside(replace(EIGHT[0], mounts=mounts), drawn) == text
    assert outside(two, drawn) == "2 LiDARs, not 4 to 4"
    assert outside(EIGHT[0].with_lidar(Lidar((0.0,), 90)), drawn) == "another LiDAR model"


def test_headings_of_a_whole_turn_and_a_single_lidar_can_be_drawn_around():
    turned = Placement("turned", [Mount(z=2, roll=-math.tau, yaw=math.tau)], Lidar.paper())
    assert [len(rig.mounts) for rig in random_rigs([turned], 8, 0)] == [1] * 8
    assert len(random_rigs([turned], 1, 0)) == 1
