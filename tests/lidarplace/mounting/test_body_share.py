"""The own body in view: against every ray on its own, embreex, and cases known by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount
from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.vehicle import Vehicle

CAR = Vehicle.car()
SMALL = Lidar(tuple(np.radians([-90.0, -40.0, -25.0, -9.0, 0.0, 5.0, 90.0])), azimuth_steps=72)
ALL = 10**6  # azimuth steps: all that are fired
angle = st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi]) | st.floats(-math.pi, math.pi)
mounts = st.builds(
    Mount,
    x=st.floats(-4, 4) | st.sampled_from([-2.35, 2.35, 0.0]),
    y=st.floats(-2, 2) | st.sampled_from([-0.95, 0.95, 0.0]),
    z=st.floats(0, 3) | st.sampled_from([0.95, 1.5]),
    roll=angle,
    pitch=angle,
    yaw=angle,
)
lidars = st.builds(
    Lidar,
    st.just(SMALL.elevations),
    st.just(72),
    range=st.floats(0.01, 5) | st.just(math.inf),
    azimuth=st.tuples(st.floats(-4, 4), st.floats(0.1, 2 * math.pi)).map(
        lambda view: (view[0], view[0] + view[1])
    ),
)


def body(seed, number):
    rng = np.random.default_rng(seed)
    centre = rng.uniform([-3, -1, 0], [3, 1, 1.5], (number, 3))
    half = rng.uniform(0, [2, 0.7, 0.6], (number, 3))
    return Vehicle("random", np.stack([centre - half, centre + half], axis=1))


def one_by_one(mount, lidar, vehicle):
    """Each ray against each box: an open interval of distances for each axis."""
    met = np.zeros(lidar.rays, bool)
    for r, ray in enumerate(lidar.directions() @ mount.rotation.T):
        for low, high in vehicle.interior:
            spans = [(0.0, lidar.range)]
            for place, d, a, b in zip(mount.position, ray, low, high, strict=True):
                if d == 0:
                    spans.append((0.0, math.inf) if a < place < b else (0.0, 0.0))
                else:
                    spans.append(tuple(sorted(((a - place) / d, (b - place) / d))))
            met[r] |= max(span[0] for span in spans) < min(span[1] for span in spans)
    return met.mean()


@given(mount=mounts, lidar=lidars, seed=st.integers(0, 10**6))
@settings(max_examples=30, derandomize=True)
def test_agrees_with_ray_by_ray(mount, lidar, seed):
    vehicle = body(seed, 3)
    assert body_share(mount, lidar, vehicle, ALL) == one_by_one(mount, lidar, vehicle)


def test_on_a_face_only_rays_into_it_meet_the_body():
    up = Lidar(tuple(np.radians([0.0, 1.0, 45.0, 90.0])), azimuth_steps=360)
    down = Lidar(tuple(np.radians([-1e-4, -1.0, -45.0, -90.0])), azimuth_steps=360)
    on_roof = Mount(0.0, 0.0, CAR.height)
    assert body_share(on_roof, up, CAR) == 0
    assert body_share(on_roof, down, CAR) == 1
    assert body_share(replace(on_roof, roll=math.pi), up, CAR) == 0.75  # not what runs along it
    # On the front face and along the axes half of the turn looks forward, or aside.
    flat = Lidar((0.0,), azimuth_steps=360)
    assert body_share(Mount(2.35, 0.0, 0.5), flat, CAR) == 179 / 360


def test_fewer_azimuth_steps_change_little():
    lidar, rng = Lidar.paper(), np.random.default_rng(0)
    for _ in range(30):
        place = rng.uniform([-2, -0.9, 1.52, -0.5, -0.5, -3], [2, 0.9, 2.2, 0.5, 0.5, 3])
        mount = Mount(*place.tolist())
        exact = body_share(mount, lidar, CAR, ALL)
        assert body_share(mount, lidar, CAR) == pytest.approx(exact, abs=2e-3)
