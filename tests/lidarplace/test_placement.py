"""Mounts and placements: the paper's eight, CARLA's convention, and what its code does."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement, Roi
from lidarplace.clouds.profiles import PROFILES, Profile, with_tilt_in_degrees
from lidarplace.coverage import coverage
from lidarplace.coverage.rays import ray_counts
from lidarplace.rigs.pose import from_carla, rotation

DATA = Path(__file__).parents[1] / "data"
TABLE = pd.read_csv(DATA / "paper_placements.csv")
CARLA = json.loads((DATA / "carla_transforms.json").read_text())["poses"]


def test_senses_of_rotation():
    x, y = np.eye(3)[:2]
    assert (rotation(0, 0.1, 0) @ x)[2] < 0, "pitch > 0 tips the nose down"
    assert (rotation(0.1, 0, 0) @ y)[2] > 0, "roll > 0 lifts the left side"
    assert (rotation(0, 0, 0.1) @ x)[1] > 0, "yaw > 0 turns to the left"


@pytest.mark.parametrize("pose", CARLA)
def test_conversion_agrees_with_carla(pose):
    own = tuple(pose[name] for name in ("x", "y", "z", "roll", "pitch", "yaw"))
    x, y, z, *angles = from_carla(*own)
    assert from_carla(x, y, z, *angles) == own
    mirror = np.diag([1.0, -1.0, 1.0])
    theirs = np.array(pose["matrix"])
    # CARLA computes in float32.
    np.testing.assert_allclose(rotation(*angles), mirror @ theirs[:3, :3] @ mirror, atol=1e-6)
    np.testing.assert_allclose([x, y, z], mirror @ theirs[:3, 3], atol=1e-6)


def test_paper_placements_are_the_papers_table():
    assert list(PAPER_PLACEMENTS) == list(TABLE["placement"].unique())
    for name, rows in TABLE.groupby("placement"):
        poses = rows[["x_m", "y_m", "z_m", "roll_rad", "pitch_rad"]].to_numpy().tolist()
        assert set(PAPER_PLACEMENTS[name].mounts) == {Mount(*from_carla(*pose)) for pose in poses}


def test_lidars_of_the_paper_and_of_its_code():
    assert PROFILES["paper"].lidar == Lidar.paper()
    for name, rays in (("paper", 90_000), ("released-code", 4_000)):
        lidar = PROFILES[name].lidar
        assert lidar.rays == rays
        np.testing.assert_allclose(np.degrees(lidar.elevations), np.linspace(-25, 5, 16))
        np.testing.assert_allclose(np.linalg.norm(lidar.directions(), axis=1), 1.0)


def test_every_mount_may_have_a_model_of_its_own():
    few, many = Lidar((0.0,), 10), Lidar((-0.1, 0.1), 20)
    mounts = [Mount(z=1), Mount(z=2)]
    mixed = Placement("mixed", mounts, lidar=[few, many])
    assert mixed.lidars == (few, many)
    assert mixed != Placement("mixed", mounts, lidar=[many, few])
    alike = Placement("mixed", mounts, lidar=[few, few])
    assert alike == Placement("mixed", mounts, lidar=few)
    assert alike.lidars == (few, few)
    assert mixed.with_lidar(few) == alike


def test_a_mixed_rig_covers_what_its_lidars_cover_alone():
    roi = Roi((0, 8), (-4, 4), (0, 2), 0.5)
    models = [Lidar((-0.3, 0.0), 90), Lidar((-0.2,), 200, range=5.0)]
    mounts = [Mount(z=1.5), Mount(x=1, y=0.5, z=1.8, roll=0.2)]
    alone = [Placement("one", [m], lidar=model) for m, model in zip(mounts, models, strict=True)]
    mixed = Placement("mixed", mounts, lidar=models)
    for method in ("cone", "dda"):
        parts = [coverage(rig, roi, method) for rig in alone]
        np.testing.assert_array_equal(coverage(mixed, roi, method), parts[0] | parts[1])
    counts = [ray_counts(rig, roi, "dda") for rig in alone]
    np.testing.assert_array_equal(ray_counts(mixed, roi, "dda"), counts[0] + counts[1])


def test_tilts_are_taken_for_degrees():
    placement = PAPER_PLACEMENTS["pyramid_roll"]
    released = with_tilt_in_degrees(placement)
    for before, after in zip(placement.mounts, released.mounts, strict=True):
        assert after.roll == pytest.approx(math.radians(before.roll))
        assert (before.x, before.y, before.z, before.yaw) == (after.x, after.y, after.z, after.yaw)
    assert released.mounts[3].roll == pytest.approx(0.0048869, abs=1e-7)
    pitched = with_tilt_in_degrees(PAPER_PLACEMENTS["pyramid_pitch"])
    assert pitched.mounts[1].pitch == pytest.approx(0.09 * math.pi / 180)


def test_a_quirk_alone():
    placement = PAPER_PLACEMENTS["line_roll"]
    assert PROFILES["paper"].placement(placement) == placement
    sparse = Profile(PROFILES["released-code"].lidar)
    assert sparse.placement(placement) == placement
    tilted = Profile(Lidar.paper(), tilt_in_degrees=True).placement(placement)
    assert tilted == with_tilt_in_degrees(placement)
    everything = PROFILES["released-code"]
    assert everything.misaligned_heights
    assert everything.placement(placement) == tilted
