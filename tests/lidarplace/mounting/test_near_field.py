"""Share that is seen right around the vehicle, against a test of every voxel on its own."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount, Placement, Roi
from lidarplace.coverage import coverage
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import Vehicle

NOTHING = Vehicle("nothing", np.empty((0, 2, 3)))
NEAR = Roi((-3.6, 3.6), (-1.6, 1.6), (0.0, 1.6), 0.4)
ALL_ROUND = Lidar(tuple(np.radians(np.linspace(-90, 90, 181))), azimuth_steps=3600)
angle = st.sampled_from([0.0, math.pi / 2, -math.pi / 2]) | st.floats(-math.pi, math.pi)
mounts = st.builds(
    Mount, st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(0, 2.5), angle, angle, angle
)
lidars = st.builds(
    Lidar,
    st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=6).map(tuple),
    st.just(3600),
    range=st.floats(0.3, 10),
    azimuth=st.tuples(st.floats(-4, 4), st.floats(0.2, 2 * math.pi)).map(
        lambda view: (view[0], view[0] + view[1])
    ),
)


def share_seen(placement, vehicle, roi):
    seen, counted = seen_in_columns(placement, vehicle, roi)
    return seen.sum() / counted.sum()


def in_boxes(points, vehicle):
    """Return which points, shape (..., 3), are inside of a box."""
    low, high = vehicle.boxes[:, 0], vehicle.boxes[:, 1]
    return ((points[..., None, :] > low) & (points[..., None, :] < high)).all(-1).any(-1)


def in_sight(origin, centre, vehicle):
    """No piece of the line between two faces' planes lies in a box."""
    with np.errstate(divide="ignore", invalid="ignore"):
        faces = ((vehicle.boxes - origin) / (centre - origin)).ravel()
    cuts = np.sort([0, *faces[(faces > 0) & (faces < 1)], 1])
    middles = 0.5 * (cuts[:-1] + cuts[1:])[cuts[1:] - cuts[:-1] > 1e-7]
    return not in_boxes(origin + middles[:, None] * (centre - origin), vehicle).any()


def voxel_by_voxel(placement, vehicle, roi):
    centres = np.stack(np.meshgrid(*map(roi.centres, range(3)), indexing="ij"), axis=-1)
    seen = np.zeros(roi.shape, bool)
    for mount, lidar in zip(placement.mounts, placement.lidars, strict=True):
        covered = coverage(Placement("one", [mount], lidar), roi)
        for voxel in np.argwhere(covered & ~seen).tolist():
            seen[tuple(voxel)] = in_sight(mount.position, centres[tuple(voxel)], vehicle)
    outside = ~in_boxes(centres, vehicle)
    return (seen & outside).sum() / outside.sum()


sensor_lists = st.lists(
    st.tuples(mounts, lidars), min_size=1, max_size=3, unique_by=lambda own: tuple(own[0].position)
)


@given(sensors=sensor_lists, seed=st.integers(0, 99))
@settings(max_examples=25, derandomize=True)
def test_agrees_with_voxel_by_voxel(sensors, seed):
    rng = np.random.default_rng(seed)
    centre = rng.uniform([-2, -1, 0], [2, 1, 1], (2, 3))
    half = rng.uniform(0.1, [1.5, 0.8, 0.7], (2, 3))
    vehicle = Vehicle("random", np.stack([centre - half, centre + half], axis=1))
    placement = Placement("p", [mount for mount, _ in sensors], [lidar for _, lidar in sensors])
    expected = voxel_by_voxel(placement, vehicle, NEAR)
    assert share_seen(placement, vehicle, NEAR) == expected


def test_without_a_body_it_is_the_coverage():
    roi = Roi((-4, 4), (-3, 3), (0, 14), 0.2)  # more than 64 layers
    mounts = [Mount(0, 0.6, 2.2, roll=-0.3), Mount(0, -0.6, 2.2, pitch=0.2)]
    placement = Placement("p", mounts, Lidar.paper())
    expected = coverage(placement, roi).mean()
    assert share_seen(placement, NOTHING, roi) == pytest.approx(expected, abs=1e-15)


def test_a_lidar_on_a_face_sees_its_side_and_one_inside_sees_nothing():
    wall = Vehicle("wall", np.array([[[-9, -0.2, 0], [9, 0.2, 9]]]))
    roi = Roi((-2, 2), (-2.2, 2.2), (0, 1), 0.2)
    on_face, within = Mount(0.1, 0.2, 0.5), Mount(0.1, 0.0, 0.5)
    assert share_seen(Placement("p", [on_face], ALL_ROUND), wall, roi) == 0.5
    assert share_seen(Placement("p", [within], ALL_ROUND), wall, roi) == 0
