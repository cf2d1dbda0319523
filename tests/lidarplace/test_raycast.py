"""Ray casting against a brute-force reference, embreex, and rays that trip naive code."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.lidar.raycast import BODY, GROUND, NOTHING, OWN_BODY, cast, visible_share
from lidarplace.placement import Mount
from lidarplace.pose import rotation
from lidarplace.sensor import Lidar

SMALL = Lidar(tuple(np.radians([-25.0, -9.0, -3.0, 0.0, 5.0])), azimuth_steps=180)
NO_BOXES = np.empty((0, 7))


def one_ray(elevation: float, reach: float = 100.0) -> Lidar:
    """A LiDAR whose only ray points along x, at `elevation`."""
    return Lidar((elevation,), azimuth_steps=1, range=reach)


def random_boxes(seed: int, number: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.stack(
        [
            rng.uniform(-60, 60, number),
            rng.uniform(-60, 60, number),
            rng.uniform(0, 3, number),
            *rng.uniform(0.3, 6, (3, number)),
            rng.uniform(-math.pi, math.pi, number),
        ],
        axis=1,
    )


def brute_force(mount: Mount, lidar: Lidar, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every ray against every box, own body and ground: (range, target)."""
    rays = lidar.directions() @ mount.rotation.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ground = np.where(rays[:, 2] < 0, -mount.z / rays[:, 2], np.inf)
        ground[(ground < 0) | (ground > lidar.range)] = np.inf
        best = ground
        target = np.where(np.isfinite(ground), GROUND, NOTHING)
        for index, box in [(BODY, np.array(OWN_BODY)), *enumerate(boxes)]:
            turn = rotation(0, 0, box[6])
            origin, direction = (mount.position - box[:3]) @ turn, rays @ turn
            faces = np.stack([-box[3:6] / 2 - origin, box[3:6] / 2 - origin])[:, None] / direction
            enter, leave = faces.min(axis=0).max(axis=1), faces.max(axis=0).min(axis=1)
            hit = (enter >= 0) & (enter <= leave) & (enter <= lidar.range) & (enter < best)
            best, target = np.where(hit, enter, best), np.where(hit, index, target)
    return best, target


poses = st.builds(
    Mount,
    x=st.floats(-3, 3),
    y=st.floats(-2, 2),
    z=st.floats(0.1, 4),
    roll=st.sampled_from([0.0, -0.28, math.pi / 2]) | st.floats(-1.5, 1.5),
    pitch=st.sampled_from([0.0, 0.09, -math.pi / 2]) | st.floats(-1.5, 1.5),
    yaw=st.floats(-math.pi, math.pi),
)


@given(mount=poses, seed=st.integers(0, 10**6))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_agrees_with_brute_force(mount, seed):
    boxes = random_boxes(seed, 25)
    hits = cast(mount, SMALL, boxes)
    expected, target = brute_force(mount, SMALL, boxes)
    np.testing.assert_array_equal(hits.target, target)
    np.testing.assert_allclose(hits.range, expected, rtol=1e-12, atol=1e-12)


@given(mount=poses, seed=st.integers(0, 10**6), x=st.floats(-30, 20), y=st.floats(-30, 20))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_crop_changes_nothing_within_it(mount, seed, x, y):
    boxes = random_boxes(seed, 25)
    crop = np.array([x, y, 0.0, x + 25, y + 15, 4.0])
    full, cut = cast(mount, SMALL, boxes), cast(mount, SMALL, boxes, tuple(crop))

    def points_within(hits):
        distance = np.where(np.isfinite(hits.range), hits.range, 1e9)
        points = mount.position + distance[:, None] * (SMALL.directions() @ mount.rotation.T)
        return ((points >= crop[:3]) & (points <= crop[3:])).all(axis=1)

    inside = points_within(full)
    np.testing.assert_array_equal(points_within(cut), inside)
    np.testing.assert_array_equal(cut.range[inside], full.range[inside])
    np.testing.assert_array_equal(cut.target[inside], full.target[inside])


@given(mount=poses, seed=st.integers(0, 10**6), low=st.floats(-7, 7), width=st.floats(0.1, 6.28))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_field_of_view_leaves_rays_out_and_changes_no_other(mount, seed, low, width):
    boxes = random_boxes(seed, 25)
    part = replace(SMALL, azimuth=(low, low + width))
    fired = np.round(part.azimuths() * SMALL.azimuth_steps / (2 * math.pi)).astype(int)
    full, cut = cast(mount, SMALL, boxes), cast(mount, part, boxes)
    assert len(cut.range) == part.rays == len(part.directions())
    for name in ("range", "target", "incidence"):
        of_turn = getattr(full, name).reshape(SMALL.beams, -1)
        np.testing.assert_array_equal(getattr(cut, name), of_turn[:, fired].ravel())


def test_agrees_with_embreex():
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("embreex")
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    lidar, mount = Lidar.paper(), Mount(0.2, 0.5, 2.2, roll=0.28, pitch=-0.09, yaw=0.3)
    boxes = random_boxes(3, 60)
    meshes = []
    for box in [OWN_BODY, *boxes]:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation(0, 0, box[6]), box[:3]
        meshes.append(trimesh.creation.box(extents=box[3:6], transform=pose))
    triangles = trimesh.util.concatenate(meshes).triangles
    # The ground as one triangle around everything, behind the 12 of each box.
    far = [[-1000.0, -1000.0, 0.0], [2000.0, -1000.0, 0.0], [-1000.0, 2000.0, 0.0]]
    triangles = np.concatenate([triangles, [far]]).astype(np.float32)
    scene = EmbreeScene()
    TriangleMesh(scene, triangles)
    rays = (lidar.directions() @ mount.rotation.T).astype(np.float32)
    origins = np.tile(mount.position.astype(np.float32), (len(rays), 1))
    primitive = scene.run(origins, rays, query="INTERSECT")
    distance = scene.run(origins, rays, query="DISTANCE")

    target = np.select(
        [(primitive < 0) | (distance > lidar.range), primitive < 12, primitive >= 12 * 61],
        [NOTHING, BODY, GROUND],
        primitive // 12 - 1,
    )
    hits = cast(mount, lidar, boxes)
    same = hits.target == target
    # Rays that graze an edge, or the end of the range, fall to either side in float32.
    assert same.mean() > 0.9995
    met = same & (target != NOTHING)
    np.testing.assert_allclose(distance[met], hits.range[met], rtol=2e-5)
    assert (target >= 0).sum() > 4000
    assert min((target == GROUND).sum(), (target == BODY).sum()) > 4000


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


def test_own_body_blocks_and_a_sensor_inside_it_sees_through():
    down = one_ray(-math.pi / 2)
    assert cast(Mount(z=2.2), down, NO_BOXES).target[0] == BODY
    assert cast(Mount(z=1.5), down, NO_BOXES).target[0] == BODY  # flush with the roof
    assert cast(Mount(z=1.0), down, NO_BOXES).target[0] == GROUND


def test_a_box_around_the_sensor_is_transparent():
    around = [10.0, 0.0, 2.0, 2.0, 2.0, 2.0, 0.4]
    behind = [20.0, 0.0, 2.0, 2.0, 2.0, 2.0, 0.0]
    hits = cast(Mount(x=10.0, z=2.0), one_ray(0.0), np.array([around, behind]))
    assert hits.target[0] == 1
    assert hits.range[0] == 9.0


def test_a_box_behind_the_sensor_is_not_met():
    box = np.array([[-10.0, 0.0, 2.0, 2.0, 2.0, 2.0, 0.0]])
    assert cast(Mount(z=2.0), one_ray(0.0), box).target[0] == NOTHING


@pytest.mark.parametrize("y", [-1.0, 1.0])
def test_an_axis_parallel_ray_along_a_face_meets_it(y):
    """The face belongs to the box; 0/0 in the slab test must not decide otherwise."""
    box = np.array([[10.0, y, 2.0, 2.0, 2.0, 2.0, 0.0]])
    hits = cast(Mount(z=2.0), one_ray(0.0), box)
    assert hits.target[0] == 0
    assert hits.range[0] == 9.0
    assert hits.incidence[0] == 1.0
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
    expected, target = brute_force(Mount(z=2.0), SMALL, box)
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


def test_incidence_is_the_cosine_to_the_normal():
    turned = np.array([[10.0, 0.0, 2.0, 0.0, 40.0, 20.0, math.pi / 3]])
    assert cast(Mount(z=2.0), one_ray(0.0), turned).incidence[0] == pytest.approx(0.5)
    assert cast(Mount(x=5, z=2.0), one_ray(-0.5), NO_BOXES).incidence[0] == pytest.approx(
        math.sin(0.5)
    )


def test_read_only_input():
    boxes = random_boxes(1, 5)
    boxes.flags.writeable = False
    expected = cast(Mount(z=2.0), SMALL, boxes.copy())
    np.testing.assert_array_equal(cast(Mount(z=2.0), SMALL, boxes).range, expected.range)


def test_visible_share_of_half_a_wall():
    """From the origin a screen hides the half of the wall to the left."""
    wall = [20.0, 0.0, 0.0, 0.0, 10.0, 10.0, 0.0]
    screen = [10.0, 20.0, 0.0, 0.0, 40.0, 40.0, 0.0]
    share = visible_share((0.0, 0.0, 0.0), np.array([wall, screen]), (64, 64))
    assert share[0] == pytest.approx(0.5, abs=1e-9)
    assert share[1] == 1.0
