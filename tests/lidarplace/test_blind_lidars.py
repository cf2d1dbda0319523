"""LiDARs that see nothing of the ROI, against points along every ray."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement, Roi
from lidarplace.clouds.blind_lidars import OBJECTS_M, SPACE_M, blind_lidars, check_not_blind
from lidarplace.clouds.own_body import body_parts, sedan
from lidarplace.clouds.raycast import cast
from lidarplace.clouds.shade import ends_of
from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.housing import NO_HOUSINGS
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.scan_pattern import ScanPattern
from tests.refused import refused

FRONT = Roi((0, 40), (-20, 20), (0, 4), 0.5)
AROUND = Roi((-40, 40), (-20, 20), (0, 4), 0.5)
NOTHING = Vehicle("nothing", np.empty((0, 2, 3)))
STEP_M = 0.05


def one(lidar, **mount):
    return Placement("mine", [Mount.degrees(**mount)], lidar)


@pytest.mark.parametrize("roi", [FRONT, AROUND])
@pytest.mark.parametrize("vehicle", [None, Vehicle.car(), NOTHING])
def test_every_lidar_of_the_paper_sees(roi, vehicle):
    for rig in PAPER_PLACEMENTS.values():
        assert blind_lidars(rig, roi, vehicle) == []


@pytest.mark.parametrize(
    ("name", "mount", "roi", "sees"),
    [
        ("bpearl", {"z": 2.6}, AROUND, False),  # a dome that looks at the sky
        ("bpearl", {"z": 2.6, "roll": 180}, FRONT, True),
        ("bpearl", {"z": 2.6, "pitch": 90}, FRONT, True),
        ("bpearl", {"z": 1.5}, FRONT, True),  # the tops of cars
        ("at128", {"x": -2.5, "z": 1.0, "yaw": 180}, FRONT, False),
        ("at128", {"x": -2.5, "z": 1.0, "yaw": 180}, AROUND, True),
        ("at128", {"x": 2.45, "z": 0.6, "yaw": 180}, AROUND, False),  # at its own bumper
        ("at128", {"x": 2.45, "z": 0.6}, AROUND, True),
        ("mid70", {"z": 2.0}, FRONT, True),
        ("mid70", {"z": 2.0, "pitch": -40}, AROUND, False),
    ],
)
def test_lidars_by_name(name, mount, roi, sees):
    rig = one(Lidar.named(name), **mount)
    assert blind_lidars(rig, roi, None) == ([] if sees else [0])
    both = Placement("two", [Mount(z=2.2), *rig.mounts], [Lidar.paper(), *rig.lidars])
    assert blind_lidars(both, roi, None) == ([] if sees else [1])


def test_range_and_least_range():
    flat = {"elevation_deg": (0, 0), "beams": 1, "azimuth_steps": 90}
    far = Roi((30, 40), (-5, 5), (0, 4), 0.5)
    for limits, sees in (
        ({"range": 30.6}, True),
        ({"range": 30.4}, False),  # less than an object needs
        ({"range": 100.0, "min_range": 39.0}, True),
        ({"range": 100.0, "min_range": 41.0}, False),
    ):
        rig = one(Lidar.even(**flat, **limits), z=1.0)
        assert blind_lidars(rig, far, NOTHING) == ([] if sees else [0])


@pytest.mark.parametrize(("start", "floor", "sees"), [(1.9, 0, 1), (2.1, 0, 0), (1.4, 0.5, 0)])
def test_a_ray_needs_no_room_above_the_ground(start, floor, sees):
    """It enters the ROI a tenth of a metre before its end, the ground or another floor."""
    down = one(Lidar((math.radians(-45),), azimuth_steps=1), z=2.0)
    roi = Roi((start, start + 4), (-2, 2), (floor, 4), 0.5)
    assert blind_lidars(down, roi, NOTHING) == [0] * (1 - sees)


def test_a_pattern_sees_what_any_of_its_frames_does():
    up, down = math.radians(80), math.radians(-30)
    pattern = ScanPattern(np.zeros(6), np.array([up, up, up, up, down, up]), 2)
    assert blind_lidars(one(Lidar.patterned(pattern), z=2.0), FRONT, NOTHING) == []
    never = ScanPattern(np.zeros(6), np.full(6, up), 2)
    assert blind_lidars(one(Lidar.patterned(never), z=2.0), FRONT, NOTHING) == [0]


def test_other_lidars_hide_what_is_behind_them():
    narrow = Lidar.even(1, (0, 0), 3600, (-2, 2))
    wall = Lidar.even(1, (0, 0), 3600, size=(0.1, 2.0, 2.0))
    rig = Placement("two", [Mount(z=1.0), Mount(x=0.3, z=1.0)], [narrow, wall])
    assert blind_lidars(rig, FRONT, NOTHING) == [0]
    hidden = Placement("one", [rig.mounts[0]], narrow, dead=[(rig.mounts[1], wall)])
    assert blind_lidars(hidden, FRONT, NOTHING) == [0], "by a dead one, too"
    assert blind_lidars(Placement("one", [rig.mounts[0]], narrow), FRONT, NOTHING) == []


@pytest.mark.parametrize(
    ("size", "turn", "place", "inside"),
    [
        ((0.3, 0.1, 0.2), 0, (0.14, 0.04, 0.09), True),
        ((0.3, 0.1, 0.2), 0, (0.14, 0.06, 0.0), False),
        ((0.3, 0.1, 0.2), 90, (0.04, -0.14, 0.0), True),  # the long side is along y
        ((0.3, 0.1, 0.2), 90, (0.14, 0.04, 0.0), False),
        ((0.2, 0.2, 0.2), 0, (0.07, 0.07, 0.0), True),  # a cylinder
        ((0.2, 0.2, 0.2), 0, (0.08, 0.08, 0.0), False),
    ],
)
@pytest.mark.parametrize("is_dead", [False, True])
def test_a_lidar_inside_of_a_housing_is_named(size, turn, place, inside, is_dead):
    housing = Mount.degrees(z=2.0, yaw=turn), Lidar.even(1, (0, 0), 90, size=size)
    mount, lidar = Mount(place[0], place[1], 2.0 + place[2]), Lidar.paper()
    rig = Placement("rig", [mount], lidar, dead=[housing])
    if not is_dead:
        rig = Placement("rig", [mount, housing[0]], [lidar, housing[1]])
    assert (0 in blind_lidars(rig, AROUND, NOTHING)) == inside
    if inside:
        with refused("^'rig': LiDAR 1 at .* is inside the housing of LiDAR 2; move it"):
            check_not_blind(rig, AROUND, NOTHING)
    else:
        check_not_blind(rig, AROUND, NOTHING)


lengths = st.floats(-3, 3).map(lambda value: round(value, 3))


@given(
    place=st.tuples(lengths, lengths, st.floats(0.3, 3.5)),
    turn=st.tuples(st.integers(-180, 180), st.integers(-90, 90), st.integers(-180, 180)),
    elevations=st.lists(st.integers(-60, 60), min_size=1, max_size=3),
    half=st.integers(10, 60),
    reach=st.floats(1, 30),
    nearest=st.floats(0, 0.9),
    corner=st.tuples(lengths, lengths),
    box=st.tuples(lengths, lengths, st.floats(0.1, 2.0)),
)
def test_against_points_along_the_rays(place, turn, elevations, half, reach, nearest, corner, box):
    """Where points clearly see, no ray is missed, and a ray that sees has points to show for it."""
    beams, view = tuple(sorted(map(math.radians, elevations))), math.radians(half)
    lidar = Lidar(beams, 24, reach, azimuth=(-view, view), min_range=nearest)
    mount = Mount.degrees(*place, *turn)
    roi = Roi((corner[0], corner[0] + 8), (corner[1], corner[1] + 6), (0, 3), 0.5)
    vehicle = Vehicle("box", np.array([[[*box[:2], 0], [box[0] + 2, box[1] + 1, box[2]]]]))
    t = np.arange(STEP_M, reach, STEP_M)
    low, high = vehicle.boxes[0]
    least = SPACE_M / STEP_M
    clearly = perhaps = False
    for ray in lidar.directions() @ mount.rotation.T:
        at = mount.position + t[:, None] * ray
        for margin in (-STEP_M, 3 * STEP_M):
            body = ((low + margin < at) & (at < high - margin)).all(axis=1)
            stop = np.append(body | (at[:, 2] < 0), True)
            end = int(stop.argmax())
            sides = np.array([roi.x, roi.y, (0, OBJECTS_M)]) + np.array([-margin, margin])
            seen = ((sides[:, 0] < at) & (at < sides[:, 1])).all(axis=1) & (t > nearest - margin)
            if margin < 0:
                clearly |= seen[:end].sum() > least + 6
            else:
                grounded = seen[:end][-1:].any() and end < len(t) and at[end, 2] < STEP_M
                perhaps |= bool(seen[:end].sum() > least - 6 or grounded)
    found = blind_lidars(Placement("mine", [mount], lidar), roi, vehicle)
    if clearly:
        assert found == []
    if not perhaps:
        assert found == [0]


def test_the_sedan_as_a_surface_is_that_of_its_parts():
    """Share of rays that meet it, of LiDARs all around it."""
    lidar = Lidar.even(32, (-60, 30), 180, range=10.0)
    rng = np.random.default_rng(0)
    for x, y, z in rng.uniform((-3, -1.5, 1.6), (3, 1.5, 2.5), (20, 3)):
        mount = Mount(x, y, z)
        met = cast(mount, lidar, body_parts(None), ends=ends_of(mount, lidar, NO_HOUSINGS))
        own = float((met.target == body_parts(None).owner[0]).mean())
        assert body_share(mount, lidar, sedan(), 180) == pytest.approx(own, abs=2e-3)
