"""Patterns that do not repeat: against LiDARs whose beams turn, and the formula of the rosette."""

import cmath
import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, KDTree

from lidarplace import Lidar, Mount, Placement, Roi
from lidarplace.clouds.collect import collect
from lidarplace.clouds.raycast import beams_of
from lidarplace.clouds.shade import ends_of
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.coverage import coverage
from lidarplace.coverage.rays import ray_counts, ray_weight
from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.housing import NO_HOUSINGS, housings_of, without
from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.ring_overlap import interleaving, rings
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.requirements.rays_on_objects import count_cells, count_points, sights_of
from lidarplace.rigs.scan_pattern import ScanPattern
from tests.lidarplace.recall.small_scenes import CURVES, MOUNTS, ROWS, log_of
from tests.lidarplace.recall.small_scenes import ROI as ROI_OF_ROWS
from tests.lidarplace.test_raycast import assert_as_brute_force, poses, random_parts

TURNING = Lidar(tuple(np.radians([-40.0, -15.0, -3.0, 4.0])), azimuth_steps=120, range_10=20.0)
ROI = Roi((-10, 10), (-10, 10), (0, 3), 0.5)


def as_table(lidar: Lidar) -> Lidar:
    """A LiDAR that fires the same rays, which a table lists in a random order."""
    rays = np.random.default_rng(4).permutation(lidar.directions())
    pattern = ScanPattern(np.arctan2(rays[:, 1], rays[:, 0]), np.arcsin(rays[:, 2]), len(rays))
    return replace(lidar, azimuth_steps=1, azimuth=(-1.0, 1.0), pattern=pattern)


TABLE = as_table(TURNING)


def matched(lidar: Lidar, table: Lidar) -> np.ndarray:
    """Which ray of `table` each ray of `lidar` is."""
    order = [np.lexsort(np.round(own.directions(), 9).T) for own in (lidar, table)]
    places = np.empty(len(order[0]), int)
    places[order[0]] = order[1]
    return places


@given(mount=poses, seed=st.integers(0, 10**6), rays=st.integers(1, 60))
@settings(max_examples=40, derandomize=True)
def test_rays_in_any_direction_agree_with_brute_force(mount, seed, rays):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-math.pi, math.pi, rays), rng.uniform(-math.pi / 2, math.pi / 2, rays)
    lidar = Lidar.patterned(ScanPattern(*angles, rays))
    assert_as_brute_force(mount, lidar, random_parts(seed, 25), 1e-11, 0.9)


MOUNT = Mount(0.3, 0.2, 1.9, 0.1, 0.2, 0.4)
OBJECTS = np.array([[x, y, 0.8, 4.2, 1.8, 1.6, 0.3 * x] for x in (-9, 4, 8) for y in (-6, 0, 5)])


@pytest.mark.parametrize("number", [0, 1], ids=["of one", "past another LiDAR"])
def test_a_table_of_the_same_rays_counts_the_same_on_objects(number):
    """Points, cells, what a mesh, a box and another LiDAR hide, and the share on the body."""
    other = replace(TURNING, size=(0.3, 0.3, 0.4)), Mount(0.8, 0.2, 1.9)
    car, found = Vehicle.car(), []
    for lidar in (TURNING, TABLE):
        lidars, mounts = [lidar, other[0]], [MOUNT, other[1]]
        rig = Placement("rig", mounts[: number + 1], lidar=lidars[: number + 1])
        sights = sights_of(rig, car)
        hidden = without(housings_of(rig.mounts, rig.lidars), 0)
        sets = [(n,) for n in range(number + 1)]
        points = count_points(sights, OBJECTS, sets=sets)
        cells = count_cells(sights, OBJECTS, 0.2, sets=sets)
        shares = body_share(MOUNT, lidar, car, 120, hidden)
        found.append([points.tolist(), cells.tolist(), shares])
    assert found[0] == found[1]
    assert np.array(found[0][0])[:, 0].any()


def test_a_mesh_hides_the_same_from_a_table():
    corners = np.array(list(product((-2.0, 2.0), (-0.9, 0.9), (0.3, 1.7))))
    body = Vehicle("mesh", np.empty((0, 2, 3)), Mesh(corners, ConvexHull(corners).simplices))
    turning, table = (ends_of(MOUNT, own, NO_HOUSINGS, body) for own in (TURNING, TABLE))
    np.testing.assert_allclose(table[matched(TURNING, TABLE)], turning, rtol=1e-9, atol=1e-12)
    assert (turning > 0).any()


def test_voxels_of_a_table_are_those_of_its_rays():
    rig, table = (Placement("rig", [MOUNT], lidar=own) for own in (TURNING, TABLE))
    for method in ("cone", "dda"):
        np.testing.assert_array_equal(coverage(table, ROI, method), coverage(rig, ROI, "dda"))
    np.testing.assert_array_equal(ray_counts(table, ROI, "dda"), ray_counts(rig, ROI, "dda"))

    both = Placement("rig", [MOUNT, Mount(0, 1, 2)], lidar=[TURNING, TABLE])
    assert ray_weight(both, 4) == 4
    all_rays, few = ray_counts(both, ROI, "dda").sum(), ray_counts(both, ROI, "dda", 4).sum()
    assert 4 * few == pytest.approx(all_rays, rel=0.05), "a stride leaves out rays of a table, too"


def test_a_pattern_has_no_rings():
    level = [Mount(0, y, 2.0) for y in (-0.5, 0.5)]
    rig = Placement("rig", level, lidar=TABLE)
    assert rings(rig).all == 0
    assert interleaving(rig) is None


def test_a_frame_goes_on_where_the_last_one_ended_and_begins_anew():
    angles = np.radians(np.arange(7.0))
    lidar = Lidar.patterned(ScanPattern(angles, -angles, 3))
    assert lidar.rays == 3
    seen = [np.degrees(lidar.in_frame(number).elevations).round().tolist() for number in range(4)]
    assert seen == [[0, -1, -2], [-3, -4, -5], [0, -1, -2], [-3, -4, -5]]
    assert lidar.in_frame(2) == lidar
    assert lidar.in_frame(1) != lidar


def test_equal_patterns_are_equal_and_changed_ones_are_not():
    angles = np.linspace(-1, 1, 50)
    one, same = (Lidar.patterned(ScanPattern(angles, angles, 10)) for _ in range(2))
    assert one == same
    assert hash(one) == hash(same)
    assert beams_of(one) is beams_of(same)
    assert one != Lidar.patterned(ScanPattern(angles, angles, 25))
    assert one != Lidar.patterned(ScanPattern(angles, -angles, 10))


@given(
    azimuths=st.lists(st.floats(-6.28, 6.28), min_size=1, max_size=30), turn=st.floats(-3.1, 3.1)
)
@settings(max_examples=200)
def test_the_field_of_view_holds_all_rays_and_is_narrow(azimuths, turn):
    pattern = ScanPattern(np.array(azimuths), np.zeros(len(azimuths)), len(azimuths))
    low, high = pattern.field_of_view
    away = (np.array(azimuths) - low) % (2 * math.pi)
    assert (np.minimum(away, 2 * math.pi - away) <= high - low + 1e-9).all()
    assert ((away <= high - low + 1e-9) | (away >= 2 * math.pi - 1e-9)).all()
    narrow = ScanPattern(np.linspace(turn - 0.5, turn + 0.5, 40), np.zeros(40), 40).field_of_view
    assert narrow[1] - narrow[0] == pytest.approx(1.0)
    assert cmath.exp(1j * (sum(narrow) / 2 - turn)) == pytest.approx(1.0)


def test_thinned_evenly_within_every_frame():
    pattern = ScanPattern(np.arange(2000) / 1000, np.zeros(2000), 1000)
    few = pattern.thinned(0.01)
    assert (few.frames, few.rays_per_frame) == (2, 10)
    np.testing.assert_allclose(np.diff(few.azimuths), 0.1, atol=1e-9)


def test_the_rosette_is_the_sum_of_two_turning_vectors():
    lidar = Lidar.named("Mid-70")
    pattern = lidar.pattern
    assert pattern is not None
    assert lidar.rays == 10_000
    for ray in (0, 1, 777, 123_456, len(pattern.azimuths) - 1):
        turned = (math.tau * rpm / 60 * ray / 100_000 for rpm in (7294, -4664))
        bent = [cmath.rect(math.radians(70.4 / 4), angle) for angle in turned]
        away, clock = cmath.polar(sum(bent))
        across, up = math.sin(away) * math.cos(clock), math.sin(away) * math.sin(clock)
        azimuth, elevation = pattern.azimuths[ray], pattern.elevations[ray]
        assert math.cos(elevation) * math.sin(azimuth) == pytest.approx(across, abs=1e-9)
        assert math.sin(elevation) == pytest.approx(up, abs=1e-9)
    off_axis = np.degrees(np.arccos(np.cos(pattern.azimuths) * np.cos(pattern.elevations)))
    assert off_axis.max() == pytest.approx(35.2, abs=0.01)


def test_objects_are_counted_alike():
    log = log_of(*ROWS)
    model = ExpectedRecall.from_log(log, ROI_OF_ROWS, ["Tram", "Bus"], CURVES)
    seen = model.objects.seen_by([Placement("rig", MOUNTS, own) for own in (TURNING, TABLE)])
    assert seen[0].points.tolist() == seen[1].points.tolist()
    assert seen[0].cells.tolist() == seen[1].cells.tolist()
    assert len(seen[0].cells) > 20


def test_clouds_show_another_part_in_every_frame_and_for_every_lidar_whatever_the_portion():
    log = log_of(*((frame, *ROWS[0][1:]) for frame in range(4)))
    two = [Mount(y=y, z=2.2) for y in (-0.4, 0.4)]
    crop = (-40.0, -40.0, -1.0, 40.0, 40.0, 4.0)
    rig = Placement("two", two, lidar=replace(Lidar.named("mid70"), range_noise=0.0))
    clouds = collect(log, [0, 1, 2, 3], rig, crop, seed=3)
    for frame in range(4):
        own = collect(log, [frame], rig, crop, seed=3)
        np.testing.assert_array_equal(own[0], clouds[frame])
    parts = []
    for frame, cloud in enumerate(clouds):
        for lidar, mount in enumerate(two):
            points = cloud[clouds.lidar(frame) == lidar, :3] - mount.position
            rays = points / np.linalg.norm(points, axis=1, keepdims=True)
            parts.append({number for number in range(20) if fired(rig.lidars[0], number, rays)})
    assert all(len(part) == 1 for part in parts)
    assert len(set.union(*parts)) > 4


def test_a_pattern_of_one_frame_is_fired_in_every_frame():
    angles = np.linspace(-0.5, 0.5, 200)
    lidar = Lidar.patterned(ScanPattern(angles, np.full(200, -0.2), 200))
    log = log_of(*((frame, *ROWS[0][1:]) for frame in range(2)))
    rig = Placement("one", [Mount(z=2.2)], lidar)
    clouds = collect(log, [0, 1], rig, (-40.0, -40.0, -1.0, 40.0, 40.0, 4.0))
    assert (clouds.counts > 100).all()


def fired(lidar: Lidar, number: int, rays: np.ndarray) -> bool:
    """Whether all of `rays` are of that part of the pattern, up to the rounding of points."""
    nearest, _ = KDTree(lidar.in_frame(number).directions()).query(rays)
    return bool(nearest.max() < 3e-4)


def test_lists_of_livox_and_ours_are_read_alike(tmp_path):
    azimuths, elevations = [0.0, 90.0, -45.0, 180.0], [1.0, -7.0, 20.0, 52.0]
    ours, livox = tmp_path / "ours.csv", tmp_path / "livox.csv"
    rows = list(zip(azimuths, elevations, strict=True))
    ours.write_text("azimuth_deg,elevation_deg\n" + "".join(f"{a},{e}\n" for a, e in rows))
    theirs = "".join(f"0,{a % 360},{90 - e}\n" for a, e in rows)
    livox.write_text(f"Time/s,Azimuth/deg,Zenith/deg\n{theirs}")
    one = SensorSettings(pattern=ours, pattern_rays=2, range=70.0).lidar()
    assert one == SensorSettings(pattern=livox, pattern_rays=2, range=70.0).lidar()
    assert (one.rays, one.range) == (2, 70.0)
    c, s = np.cos(np.radians([1, 7])), np.sin(np.radians([1, 7]))
    np.testing.assert_allclose(one.directions(), [[c[0], 0, s[0]], [0, c[1], -s[1]]], atol=1e-12)
    ours.write_text("azimuth_deg,elevation_deg\n0,5\n10,6\n")
    own = SensorSettings(name="vlp16", pattern=ours).lidar()
    assert (own.rays, own.range) == (2, Lidar.named("vlp16").range), "read again when changed"
    named = SensorSettings(name="mid70", range=50.0).lidar()
    assert named == replace(Lidar.named("mid70"), range=50.0)
