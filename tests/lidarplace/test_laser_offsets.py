"""Lasers of one LiDAR that start above each other."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.clouds.ground import Ground
from lidarplace.clouds.raycast import Hits, cast
from lidarplace.clouds.returns import CloudPart, sample_points
from lidarplace.clouds.shapes import bricks
from lidarplace.configuration.correction import CorrectionFile
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.coverage import coverage
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.requirements.rays_on_objects import count_points, sights_of
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement, blocks
from tests.lidarplace.recall.small_scenes import log_of
from tests.refused import refused

LIDAR = Lidar(tuple(np.radians([-20.0, -12.0, -5.0, -1.0, 3.0])), azimuth_steps=240, range=60.0)
NOBODY = Vehicle("nobody", np.empty((0, 2, 3)))
ROI = Roi(x=(-12, 12), y=(-12, 12), z=(0, 3), resolution=0.5)
BOXES = np.array([[9.0, 2.0, 0.8, 4.0, 1.8, 1.6, 0.3], [-6.0, -5.0, 0.9, 0.6, 0.6, 1.8, 0.0]])
offset = st.sampled_from([-0.3, 0.0, 0.12, 0.2])
angle = st.floats(-0.5, 0.5)
offsets_of_all = st.tuples(*[offset] * LIDAR.beams)
mounts = st.builds(
    Mount, st.floats(-1, 1), st.floats(-1, 1), st.floats(1.5, 2.5), angle, angle, st.floats(-3, 3)
)


def beam_by_beam(mount: Mount, offsets: tuple[float, ...]) -> list[tuple[Mount, Lidar]]:
    """A LiDAR of one beam for each laser, where that is."""
    single = [replace(LIDAR, elevations=(elevation,)) for elevation in LIDAR.elevations]
    places = [mount.position + h * mount.rotation[:, 2] for h in offsets]
    at = [replace(mount, **dict(zip("xyz", place, strict=True))) for place in places]
    return list(zip(at, single, strict=True))


def points_of(mount: Mount, lidar: Lidar, hits: Hits) -> NDArray[np.float32]:
    points = np.empty((lidar.rays, 4), np.float32)
    ground = Ground(np.ones((1024, 1024), np.float32), (0.0, 0.0, 0.0))
    wide = (-99.0, -99.0, -9.0, 99.0, 99.0, 9.0)
    part = CloudPart((1, 2, 3))
    return points[: sample_points(mount, lidar, hits, ground, wide, part, points)]


@settings(max_examples=30, deadline=None)
@given(mount=mounts, offsets=offsets_of_all)
def test_clouds_are_those_of_lasers_that_sit_there(mount, offsets):
    lidar = replace(LIDAR, offsets=offsets)
    parts = bricks(BOXES, 0)
    hits = cast(mount, lidar, parts)
    single = beam_by_beam(mount, offsets)
    alone = [cast(*own, parts) for own in single]
    for name in ("range", "target", "reflected"):
        expected = np.concatenate([getattr(own, name) for own in alone])
        np.testing.assert_allclose(getattr(hits, name), expected, rtol=1e-12)
    expected = [points_of(*own, found) for own, found in zip(single, alone, strict=True)]
    np.testing.assert_allclose(points_of(mount, lidar, hits), np.concatenate(expected), rtol=1e-6)


@settings(max_examples=20, deadline=None)
@given(mount=mounts, offsets=offsets_of_all, drop_off=st.sampled_from([0.0, 0.3]))
def test_requirements_and_coverage_take_offsets(mount, offsets, drop_off):
    lidar = replace(LIDAR, offsets=offsets, drop_off=drop_off)
    single = [(m, replace(own, drop_off=drop_off)) for m, own in beam_by_beam(mount, offsets)]
    rig = Placement("rig", [mount], lidar)
    alone = [Placement("one", [m], own) for m, own in single]
    points = [count_points(sights_of(one, NOBODY), BOXES) for one in alone]
    sights = sights_of(rig, NOBODY)
    np.testing.assert_allclose(count_points(sights, BOXES), sum(points), rtol=1e-12)
    for method in ("cone", "dda"):
        expected = np.logical_or.reduce([coverage(one, ROI, method) for one in alone])
        np.testing.assert_array_equal(coverage(rig, ROI, method), expected)


@settings(max_examples=10, deadline=None)
@given(mount=mounts, offsets=offsets_of_all)
def test_expected_recall_sees_what_requirements_see(mount, offsets):
    """One object that nothing hides: its cells and points are those of single lasers."""
    rig = Placement("rig", [mount], replace(LIDAR, offsets=offsets))
    row = (0, "Tram", 9.0, 2.0, 4.0, 1.8, 1.6, 0.3)
    wide = Roi((-30, 30), (-30, 30), (0, 4), 0.5)
    objects = CountedObjects.from_log(log_of(row), wide, ["Tram"], 0.3, vehicle=NOBODY)
    (seen,) = objects.seen_by([rig])
    assert seen.points.tolist() == count_points(sights_of(rig, NOBODY), BOXES[:1])[0].tolist()


def test_equal_offsets_of_nothing_change_no_bit():
    zero = replace(LIDAR, offsets=(0.0,) * LIDAR.beams, range_noise=0.03, drop_off=0.2)
    none, mount, parts = replace(zero, offsets=None), Mount(z=2.0, roll=0.1), bricks(BOXES, 0)
    assert points_of(mount, zero, cast(mount, zero, parts)).tobytes() == (
        points_of(mount, none, cast(mount, none, parts)).tobytes()
    )


def test_blocks_are_runs_of_beams():
    lidar = replace(LIDAR, offsets=(0.1, 0.1, 0.2, 0.2, 0.1))
    found = blocks(Mount(z=2.0, roll=math.pi / 2), lidar)
    runs = [(own.beams, rays.start, rays.stop) for _, own, rays in found]
    assert runs == [(2, 0, 480), (2, 480, 960), (1, 960, 1200)]
    assert [round(mount.y, 12) for mount, *_ in found] == [-0.1, -0.2, -0.1]


def test_settings_have_offsets():
    own = SensorSettings(elevations_deg=(-2.0, 1.0), offsets_m=(0.1, 0.2)).lidar()
    assert own.offsets == (0.1, 0.2)
    file = CorrectionFile.model_validate({"lidars": {"top": {"offsets_m": [0.3, 0.4]}}})
    assert own.corrected(file, "top").offsets == (0.3, 0.4)
    with refused(("", "unit a", "1")):
        own.corrected(CorrectionFile.model_validate({"lidars": {"a": {"offsets_m": [0.3]}}}), "a")
    assert SensorSettings(name="hdl64e").lidar() == Lidar.named("hdl64e")
    assert Lidar.named("hdl64e").offsets is not None
    assert SensorSettings(name="hdl64e", elevations_deg=(0.0,)).lidar().offsets is None
