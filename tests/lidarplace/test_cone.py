"""Cones: two algorithms against each other, and both against points of the cones."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement, Roi
from lidarplace.coverage import coverage
from lidarplace.coverage.bits import unpack
from lidarplace.coverage.cone import cone_bits, sensor_bits
from lidarplace.coverage.tiles import Tiles
from tests.lidarplace.voxel_by_voxel import covered_voxel_by_voxel

# Several tiles of columns, and more than 64 voxels along z, with the last of each cut short.
WIDE = Roi(x=(0.0, 4.5), y=(-3.5, 3.5), z=(0.0, 7.0), resolution=0.1)
ROI = Roi(x=(0.0, 3.0), y=(-1.5, 1.5), z=(0.0, 2.0), resolution=0.25)
right_angle = math.pi / 2


def to_the_millionth(low, high):
    """Metres and radians. Cubes are grown by a hair against rounding, by column a few times as much
    where a cone is steep: the two differ for a sensor less than that from a face, not on it, and
    for a cone that passes a corner so near, not through it."""
    return st.floats(low, high).map(lambda value: round(value, 6))


angle = to_the_millionth(-math.pi, math.pi)
angle |= st.sampled_from([0.0, right_angle, -right_angle, math.pi])
# On voxel corners and faces, inside and outside the ROI, under the ground, and anywhere.
mounts = st.builds(
    Mount,
    to_the_millionth(-4, 6) | st.sampled_from([0.0, 0.5, 1.25]),
    to_the_millionth(-4, 4) | st.sampled_from([-1.5, 0.0, 0.25]),
    to_the_millionth(-3, 6) | st.sampled_from([0.0, 1.0, 2.0]),
    *[angle] * 3,
)
elevation = to_the_millionth(-1.570796, 1.570796)
elevation |= st.sampled_from([-right_angle, -math.pi / 4, 0.0, right_angle])
elevations = st.lists(elevation, min_size=1, max_size=6)


@st.composite
def lidars(draw, limited):
    azimuth, reach = (-math.pi, math.pi), 100.0
    if limited:
        start = draw(st.floats(-4, 4))
        width = draw(st.one_of(st.floats(0.05, 6.2), st.sampled_from([right_angle, math.pi])))
        azimuth = (start, start + width)
        reach = draw(st.one_of(st.floats(0.3, 8.0), st.sampled_from([0.5, 1.0, math.inf])))
    return Lidar(tuple(draw(elevations)), 720, range=reach, azimuth=azimuth)


def assert_columns_and_voxels_agree(mount, lidar, roi):
    placement = Placement("one", [mount], lidar=lidar)
    np.testing.assert_array_equal(coverage(placement, roi), covered_voxel_by_voxel(placement, roi))


@given(mounts, st.booleans().flatmap(lidars))
@example(Mount(0.5, 0.25, 1.0), Lidar((0.0, -math.pi / 4), 720))
@example(Mount(0.5, 0.25, 1.0, roll=right_angle), Lidar((-0.4, 0.0, 0.4), 720))
@example(Mount(1.0, 0.0, 5.0, pitch=right_angle), Lidar((0.3,), 720))
@example(Mount(1.0, 0.0, 1.0, pitch=math.pi), Lidar((-0.3,), 720))
@example(Mount(1.7, -0.2, 1.1, roll=-0.9, pitch=0.5), Lidar((0.7,), 720))
@example(Mount(0.2, -0.6, 0.7, roll=-0.3, pitch=-0.3), Lidar((0.8,), 720))
@example(Mount(0.4, 0.1, 1.3, 0.3, 0.4), Lidar((-0.2, 0.9), 720, range=1.7))
@settings(max_examples=400)
def test_columns_and_voxels_agree(mount, lidar):
    assert_columns_and_voxels_agree(mount, lidar, ROI)


def test_columns_and_voxels_differ_by_ties_alone():
    """A plane that rises by 3e-10 m from the faces between two rows of voxels: a sensor moved by
    1e-8 m, 40 hairs, meets other voxels there by the test of single voxels itself."""
    mount, lidar = Mount(0.0, 3.0, 0.0, roll=1e-10, pitch=1.0), Lidar((0.0,), 720)
    one = Placement("one", [mount], lidar=lidar)
    differ = coverage(one, ROI) != covered_voxel_by_voxel(one, ROI)
    shifts = 1e-8 * np.concatenate([np.eye(3), -np.eye(3)])
    moved = [
        Mount(*(mount.position + shift).tolist(), roll=mount.roll, pitch=mount.pitch)
        for shift in shifts
    ]
    near = np.array(
        [covered_voxel_by_voxel(Placement("moved", [m], lidar=lidar), ROI) for m in moved]
    )
    ties = near.any(axis=0) & ~near.all(axis=0)
    assert differ.any()
    assert not (differ & ~ties).any()
    assert np.count_nonzero(ties) < 0.1 * ties.size


@given(mounts, st.booleans().flatmap(lidars))
@settings(max_examples=25)
def test_columns_and_voxels_agree_over_several_tiles_and_words(mount, lidar):
    assert_columns_and_voxels_agree(mount, lidar, WIDE)


def seen_points(mount, lidar, azimuths, distances):
    """Points of the cones within range and field of view, shape (points, 3)."""
    spread = np.linspace(*lidar.azimuth, azimuths)
    along = np.linspace(0, min(lidar.range, 9.0), distances)
    cosine, sine = np.cos(lidar.elevations)[:, None], np.sin(lidar.elevations)[:, None]
    directions = np.stack(
        np.broadcast_arrays(cosine * np.cos(spread), cosine * np.sin(spread), sine), axis=-1
    )
    directions = directions.reshape(-1, 1, 3) @ mount.rotation.T
    return (mount.position + directions * along[:, None]).reshape(-1, 3)


@given(mounts, st.booleans().flatmap(lidars))
@settings(max_examples=60)
def test_voxels_that_are_not_covered_hold_no_point_of_a_cone(mount, lidar):
    """Independent of both algorithms."""
    covered = coverage(Placement("one", [mount], lidar=lidar), ROI)
    cells = (seen_points(mount, lidar, 300, 150) - ROI.minimum) / ROI.resolution
    cells = cells[((cells >= 0) & (cells < ROI.shape)).all(axis=1)].astype(int)
    assert covered[tuple(cells.T)].all()


@pytest.mark.parametrize(
    ("mount", "lidar"),
    [
        (Mount(-0.3, 0.1, 1.3, roll=0.2), Lidar((-0.3, 0.1), 720)),
        (Mount(0.4, 0.1, 1.3, 0.3, 0.4), Lidar((-0.2,), 720, range=1.7)),
        (Mount(1.4, 0.1, 1.0, 0.1), Lidar((-0.2, 0.9), 720, 1.2, azimuth=(1.0, 5.0))),
        (Mount(0.4, 0.1, 1.3, 0.3, 0.4), Lidar((-0.2, 0.9), 720, 1.7, azimuth=(-0.4, 0.9))),
    ],
)
def test_every_covered_voxel_has_a_point_of_a_cone_at_hand(mount, lidar):
    """Converse of the above: every covered voxel nearly touches a point of a cone."""
    covered = np.argwhere(coverage(Placement("one", [mount], lidar=lidar), ROI))
    azimuths, distances = (round(n * min(lidar.range / 4, 1.0)) for n in (2000, 700))
    points = (seen_points(mount, lidar, azimuths, distances) - ROI.minimum) / ROI.resolution
    points = points[((points > -0.04) & (points < np.array(ROI.shape) + 0.04)).all(axis=1)]
    near = np.zeros(ROI.shape, bool)
    for shift in np.array([*np.ndindex(2, 2, 2)]) * 0.08 - 0.04:
        cells = np.floor(points + shift).astype(int)
        cells = cells[((cells >= 0) & (cells < ROI.shape)).all(axis=1)]
        near[tuple(cells.T)] = True
    assert len(covered) > 50
    assert near[tuple(covered.T)].all()


def test_only_tiles_that_matter_are_filled():
    placement = PAPER_PLACEMENTS["line_roll"]
    for axis_tilt in (0.0, 1.4):  # columns along z, and along y
        matters = np.zeros(WIDE.shape, bool)
        matters[20:30, 40:60, 3:50] = True
        tilted = Placement("t", [Mount(1, 0, 2.2, roll=axis_tilt)], lidar=placement.lidar)
        whole = coverage(tilted, WIDE)
        part = unpack(cone_bits(tilted, WIDE, Tiles.of_voxels(matters)), WIDE.shape[2])
        np.testing.assert_array_equal(part[matters], whole[matters])
        assert np.count_nonzero(part) < np.count_nonzero(whole)
    nothing = Tiles.of_voxels(np.zeros(WIDE.shape, bool))
    assert not cone_bits(placement, WIDE, nothing).any()


def test_a_moved_mount_leaves_the_other_sensors_in_the_cache():
    whole = Tiles.whole(ROI.shape)
    lidar, first, second = Lidar((-0.3,), 90), Mount(0.1, 0.2, 1.0), Mount(0.1, -0.2, 1.0)
    kept = sensor_bits(lidar, first, ROI, whole)
    cone_bits(Placement("two", [first, second], lidar=lidar), ROI, whole)
    assert sensor_bits(lidar, first, ROI, whole) is kept
    # Azimuth steps have no part in the cones; what has a part makes another entry.
    assert sensor_bits(Lidar((-0.3,), 180), first, ROI, whole) is kept
    assert sensor_bits(Lidar((-0.3,), 90, range=1.0), first, ROI, whole) is not kept
    with pytest.raises(ValueError, match="read-only"):
        kept[:] = 0
