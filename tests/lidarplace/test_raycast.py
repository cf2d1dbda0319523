"""Ray casting against a brute-force reference, and rays that trip naive code."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.clouds.raycast import GROUND, NOTHING, Hits
from lidarplace.clouds.shapes import BODY, Parts, bricks, own_body
from lidarplace.clouds.visibility import visible_share
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount
from lidarplace.rigs.pose import rotation
from tests.lidarplace.from_a_car import cast as cast_parts

SMALL = Lidar(tuple(np.radians([-25.0, -9.0, -3.0, 0.0, 5.0])), azimuth_steps=180)
NO_BOXES = np.empty((0, 7))


def one_ray(elevation: float, reach: float = 100.0) -> Lidar:
    """A LiDAR whose only ray points along x, at `elevation`."""
    return Lidar((elevation,), azimuth_steps=1, range=reach)


def cast(mount: Mount, lidar: Lidar, boxes: np.ndarray, *further, **keywords) -> Hits:
    """Cast at plain boxes, which are their own owners and reflect all light."""
    parts = bricks(boxes, np.arange(len(boxes)))
    return cast_parts(mount, lidar, parts, *further, **keywords)


def random_parts(seed: int, number: int) -> Parts:
    """Boxes, the half of them with a top that stays behind the bottom at all four sides."""
    high = np.array([60, 60, 3, 6, 6, 6, math.pi])[:, None]
    low = np.array([-60, -60, 0, 0.3, 0.3, 0.3, -math.pi])[:, None]
    boxes = np.random.default_rng(seed).uniform(low, high, (7, number)).T.copy()
    inset = np.random.default_rng([seed, 1]).uniform(0, 0.5, (number, 3))
    inset *= boxes[:, [3, 3, 4]] * (np.arange(number) % 2)[:, None]
    return Parts(
        np.concatenate([boxes, inset], axis=1),
        np.arange(number, dtype=np.int32),
        np.random.default_rng([seed, 2]).uniform(0.1, 1, number),
    )


def faces(part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (8, 3) of a part in the ego frame, and its planes (6, 4): n p <= c."""
    length, width, height = part[3:6] / 2
    front, rear, side = part[7:]
    bottom = [(x, y, -height) for x in (-length, length) for y in (-width, width)]
    ends, sides = (rear - length, length - front), (side - width, width - side)
    top = [(x, y, height) for x in ends for y in sides]
    turn = rotation(0, 0, part[6])
    corners = np.array([*bottom, *top]) @ turn.T + part[:3]
    planes = []
    for three in ((0, 1, 2), (4, 5, 6), (0, 1, 4), (2, 3, 6), (0, 2, 4), (1, 3, 5)):
        a, b, c = corners[list(three)]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal) * np.sign(normal @ (a - corners.mean(axis=0)))
        planes.append([*normal, normal @ a])
    return corners, np.array(planes)


def brute_force(mount: Mount, lidar: Lidar, parts: Parts) -> tuple[np.ndarray, ...]:
    """Every ray against every plane of every part, and the ground: range, target, reflected."""
    rays = lidar.directions() @ mount.rotation.T
    everything = own_body().and_(parts)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        best = np.where(rays[:, 2] < 0, -mount.z / rays[:, 2], np.inf)
        best[(best < 0) | (best > lidar.range)] = np.inf
        target = np.where(np.isfinite(best), GROUND, NOTHING)
        reflected = np.where(np.isfinite(best), -rays[:, 2], 0)
        for p, part in enumerate(everything.geometry):
            planes = faces(part)[1]
            along = rays @ planes[:, :3].T
            distance = (planes[:, 3] - planes[:, :3] @ mount.position) / along
            into = np.where(along < 0, distance, -np.inf)
            enter, leave = into.max(axis=1), np.where(along > 0, distance, np.inf).min(axis=1)
            beside = ((along == 0) & (planes[:, :3] @ mount.position > planes[:, 3])).any(axis=1)
            hit = (enter >= 0) & (enter <= leave) & (enter <= lidar.range) & (enter < best)
            hit &= ~beside
            cosine = -along[np.arange(len(rays)), into.argmax(axis=1)]
            best, target = np.where(hit, enter, best), np.where(hit, everything.owner[p], target)
            reflected = np.where(hit, cosine * everything.reflectivity[p], reflected)
    return best, target, reflected


def assert_as_brute_force(mount, lidar, parts, tolerance, least_same) -> None:
    hits = cast_parts(mount, lidar, parts)
    expected, target, reflected = brute_force(mount, lidar, parts)
    np.testing.assert_allclose(hits.range, expected, rtol=tolerance, atol=tolerance)
    # Two surfaces at one distance, as where the own body stands on the ground: either may win.
    same = hits.target == target
    assert same.mean() > least_same
    np.testing.assert_allclose(hits.reflected[same], reflected[same], atol=tolerance)


poses = st.builds(
    Mount,
    st.floats(-3, 3),
    st.floats(-2, 2),
    st.floats(0.1, 4),
    st.sampled_from([0.0, -0.28, math.pi / 2]) | st.floats(-1.5, 1.5),
    st.sampled_from([0.0, 0.09, -math.pi / 2]) | st.floats(-1.5, 1.5),
    st.floats(-math.pi, math.pi),
)


@given(mount=poses, seed=st.integers(0, 10**6))
@settings(max_examples=40, derandomize=True)
def test_agrees_with_brute_force(mount, seed):
    assert_as_brute_force(mount, SMALL, random_parts(seed, 25), 1e-12, 0.99)


@given(mount=poses, seed=st.integers(0, 10**6), x=st.floats(-30, 20), y=st.floats(-30, 20))
@settings(max_examples=60, derandomize=True)
def test_crop_changes_nothing_within_it(mount, seed, x, y):
    parts = random_parts(seed, 25)
    crop = np.array([x, y, 0.0, x + 25, y + 15, 4.0])
    full, cut = cast_parts(mount, SMALL, parts), cast_parts(mount, SMALL, parts, tuple(crop))

    def points_within(hits):
        distance = np.where(np.isfinite(hits.range), hits.range, 1e9)
        points = mount.position + distance[:, None] * (SMALL.directions() @ mount.rotation.T)
        return ((points >= crop[:3]) & (points <= crop[3:])).all(axis=1)

    inside = points_within(full)
    np.testing.assert_array_equal(points_within(cut), inside)
    np.testing.assert_array_equal(cut.range[inside], full.range[inside])
    np.testing.assert_array_equal(cut.target[inside], full.target[inside])


@given(mount=poses, seed=st.integers(0, 10**6), low=st.floats(-7, 7), width=st.floats(0.1, 6.28))
@settings(max_examples=60, derandomize=True)
def test_a_field_of_view_leaves_rays_out_and_changes_no_other(mount, seed, low, width):
    parts = random_parts(seed, 25)
    part = replace(SMALL, azimuth=(low, low + width))
    fired = np.round(part.azimuths() * SMALL.azimuth_steps / (2 * math.pi)).astype(int)
    full, cut = cast_parts(mount, SMALL, parts), cast_parts(mount, part, parts)
    assert len(cut.range) == part.rays == len(part.directions())
    for name in ("range", "target", "reflected"):
        of_turn = getattr(full, name).reshape(SMALL.beams, -1)
        np.testing.assert_array_equal(getattr(cut, name), of_turn[:, fired].ravel())


def test_horizontal_beam_never_meets_the_ground():
    for yaw in np.linspace(-math.pi, math.pi, 37):
        hits = cast(Mount(z=2.0, yaw=yaw), Lidar((0.0,), 5625, range=math.inf), NO_BOXES)
        assert (hits.target == NOTHING).all()
        assert np.isinf(hits.range).all()


@pytest.mark.parametrize(("elevation", "target"), [(-90, GROUND), (90, NOTHING)])
def test_vertical_beams(elevation, target):
    lidar = Lidar((math.radians(elevation),), azimuth_steps=360)
    hits = cast(Mount(x=5.0, z=2.2), lidar, NO_BOXES)
    assert (hits.target == target).all()
    np.testing.assert_array_equal(hits.range, 2.2 if target == GROUND else np.inf)
    below = np.array([[5.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.3]])
    hits = cast(Mount(x=5.0, z=2.2), lidar, below)
    assert (hits.target == (0 if target == GROUND else NOTHING)).all()


def test_own_body_blocks_and_a_part_around_the_sensor_is_seen_through():
    down, level = one_ray(-math.pi / 2), one_ray(0.0)
    assert cast(Mount(z=2.2), down, NO_BOXES).target[0] == BODY
    assert cast(Mount(z=1.5), down, NO_BOXES).target[0] == BODY  # flush with the roof
    assert cast(Mount(z=1.5), down, NO_BOXES).range[0] < 1e-12
    assert cast(Mount(z=1.5), level, NO_BOXES).target[0] == NOTHING  # skims the roof
    assert cast(Mount(z=0.5), down, NO_BOXES).target[0] == GROUND
    # From within the bonnet forwards there is nothing, backwards there is the windscreen.
    assert cast(Mount(x=2.0, z=0.8), level, NO_BOXES).target[0] == NOTHING
    back = cast(Mount(x=2.0, z=0.9, yaw=math.pi), level, NO_BOXES)
    assert back.target[0] == BODY
    assert 0.5 < back.range[0] < 2.0
    around, beyond = [10.0, 0.0, 2.0, 2.0, 2.0, 2.0, 0.4], [20.0, 0.0, 2.0, 2.0, 2.0, 2.0, 0.0]
    hits = cast(Mount(x=10.0, z=2.0), one_ray(0.0), np.array([around, beyond]))
    assert (hits.target[0], hits.range[0]) == (1, 9.0)


@pytest.mark.parametrize("y", [-1.0, 1.0])
def test_an_axis_parallel_ray_along_a_face_meets_it(y):
    """The face belongs to the box; 0/0 in the slab test must not decide otherwise."""
    box = np.array([[10.0, y, 2.0, 2.0, 2.0, 2.0, 0.0]])
    hits = cast(Mount(z=2.0), one_ray(0.0), box)
    assert hits.target[0] == 0
    assert hits.range[0] == 9.0
    assert hits.reflected[0] == 1.0
    beyond = box + np.array([0, math.copysign(1e-12, y), 0, 0, 0, 0, 0])
    assert cast(Mount(z=2.0), one_ray(0.0), beyond).target[0] == NOTHING


@pytest.mark.parametrize("yaw", [1e-310, -1e-310, 1e-200])
def test_a_ray_all_but_parallel_to_a_face_through_the_sensor(yaw):
    """The inverse of such a direction overflows."""
    face = np.array([[10.0, 1.0, 2.0, 2.0, 2.0, 2.0, 0.0]])
    inside = np.array([[10.0, 0.5, 2.0, 2.0, 2.0, 2.0, 0.0]])
    beside = np.array([[10.0, 1.5, 2.0, 2.0, 2.0, 2.0, 0.0]])
    hits = [cast(Mount(z=2.0, yaw=yaw), one_ray(0.0), b) for b in (face, inside, beside)]
    assert [h.target[0] for h in hits] == [0, 0, NOTHING]
    assert [h.range[0] for h in hits[:2]] == [9.0, 9.0]


@pytest.mark.parametrize("size", [(0.0, 2.0, 2.0), (2.0, 0.0, 2.0), (2.0, 2.0, 0.0), (0.0,) * 3])
def test_zero_size_boxes(size):
    box = np.array([[10.0, 0.0, 2.0, *size, 0.0]])
    hits = cast(Mount(z=2.0), one_ray(0.0), box)
    assert hits.target[0] == 0
    assert hits.range[0] == 10.0 - size[0] / 2
    assert cast(Mount(z=2.1), one_ray(0.0), box).target[0] == (NOTHING if size[2] < 0.2 else 0)


def test_a_huge_box():
    box = np.array([[1e6, 0.0, 0.0, 2e6 - 20.0, 1e6, 1e6, 0.0]])
    hits = cast(Mount(z=2.0), SMALL, box)
    expected, target, _ = brute_force(Mount(z=2.0), SMALL, bricks(box, 0))
    np.testing.assert_array_equal(hits.target, target)
    np.testing.assert_allclose(hits.range, expected, rtol=1e-9)
    assert (target == 0).any()


def test_nothing_is_met_beyond_the_range():
    box = np.array([[10.0, 0.0, 2.0, 2.0, 2.0, 2.0, 0.0]])
    assert cast(Mount(z=2.0), one_ray(0.0, reach=9.0), box).target[0] == 0
    assert cast(Mount(z=2.0), one_ray(0.0, reach=8.999), box).target[0] == NOTHING
    slope = -math.asin(2.0 / 30.0)
    assert cast(Mount(z=2.0), one_ray(slope, reach=30.001), NO_BOXES).target[0] == GROUND
    assert cast(Mount(z=2.0), one_ray(slope, reach=29.999), NO_BOXES).target[0] == NOTHING


@pytest.mark.parametrize("z", [-1.0, 0.0])
def test_a_sensor_at_or_below_the_ground_meets_none(z):
    hits = cast(Mount(x=50.0, z=z), SMALL, NO_BOXES)
    assert set(hits.target) <= {BODY, NOTHING}


def test_visible_share_agrees_with_rays_cast_at_all():
    """The same rays as of a dense LiDAR, counted per object alone and with the others."""
    parts = random_parts(4, 30)
    objects = np.repeat(np.arange(10, dtype=np.int32), 3)
    # Three parts side by side, and none so near that own body hides it.
    beside = np.tile([[-2, 0], [0, 1], [2, 0]], (10, 1))
    at = np.repeat(parts.geometry[::3, :2], 3, axis=0) + beside
    parts.geometry[:, :2] = 0.3 * at + np.copysign([8, 0], at)
    parts = Parts(parts.geometry, objects, parts.reflectivity)
    viewpoint = Mount(z=5.0)
    lidar = Lidar(tuple(np.linspace(-1.5, 1.5, 1000)), 2000, range=math.inf)
    seen = cast_parts(viewpoint, lidar, parts).target
    share = visible_share((0.0, 0.0, 5.0), parts, 11, (200, 200))
    assert share[10] == 0  # it has no parts
    for o in range(10):
        own = objects == o
        alone = Parts(parts.geometry[own], objects[own], parts.reflectivity[own])
        number = (cast_parts(viewpoint, lidar, alone).target == o).sum()
        assert share[o] == pytest.approx((seen == o).sum() / number, abs=0.03)
    assert ((share[:10] > 0) & (share[:10] < 1)).sum() >= 3
