"""LiDARs hide each other by their size: against single rays, and cases that are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.base.roi import Roi
from lidarplace.clouds.collect import collect
from lidarplace.clouds.raycast import NO_ENDS
from lidarplace.clouds.shade import ends_in_rig, ends_of, in_view
from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.housing import housings_of, without
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import default_curves
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.requirements.rays_on_objects import count_points, sights_of
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from tests.lidarplace.recall.small_scenes import log_of
from tests.refused import refused

NOTHING = Vehicle("nothing", np.empty((0, 2, 3)))
ROUND, BOX = (0.2, 0.2, 0.1), (0.1, 0.3, 0.2)
FLAT = Lidar((0.0,), 3600, size=ROUND)


def sized(elevations, steps=360, size=ROUND, **changes):
    return Lidar(tuple(np.radians(elevations)), steps, size=size, **changes)


def march(mount, lidar, other, size, points=1501):
    """Where each ray first is inside of a housing, by steps of a millimetre or so; or inf."""
    away = np.linalg.norm(other.position - mount.position)
    along = np.linspace(0, away + 0.5, points)
    directions = lidar.directions() @ mount.rotation.T
    at = mount.position + along[:, None] * directions[:, None, :] - other.position
    local = at @ other.rotation  # R^T, row by row
    half = np.array(size) / 2
    within = np.abs(local[..., 2]) < half[2]
    if size[0] == size[1]:
        within &= np.hypot(local[..., 0], local[..., 1]) < half[0]
    else:
        within &= (np.abs(local[..., :2]) < half[:2]).all(axis=2)
    return np.where(within.any(axis=1), along[within.argmax(axis=1)], np.inf)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([ROUND, BOX, (0.4, 0.4, 0.02), (0.5, 0.05, 0.05)]),
    away=st.floats(0.0, 1.5),
    view=st.sampled_from([(-math.pi, math.pi), (-1.0, 1.0), (2.5, 4.0)]),
)
def test_rays_end_where_single_points_of_them_are_inside(seed, size, away, view):
    rng = np.random.default_rng(seed)
    mount, other = (Mount(*rng.uniform(-3, 3, 3), *rng.uniform(-3, 3, 3)) for _ in range(2))
    towards = rng.normal(size=3)
    at = mount.position + away * towards / np.linalg.norm(towards)
    other = replace(other, x=at[0], y=at[1], z=at[2])
    lidar = sized(np.linspace(-80, 85, 8), 60, azimuth=view)
    housings = housings_of([other], [sized([0.0], size=size)])
    ends = ends_of(mount, lidar, housings)
    expected = march(mount, lidar, other, size)
    if not len(ends):
        assert np.isinf(expected).all()
        return
    with np.errstate(divide="ignore"):
        found = 1 / ends
    both = np.isfinite(found) & np.isfinite(expected)
    np.testing.assert_allclose(found[both], expected[both], atol=2e-3)
    # What a march misses passes a corner: less than a step of it is inside.
    assert (np.isfinite(found) | np.isinf(expected)).all()
    only = np.isfinite(found) & np.isinf(expected)
    assert only.sum() <= 0.02 * len(found) + 4


def test_a_cylinder_hides_what_its_angle_spans():
    other = Mount(x=1.0)
    ends = ends_of(Mount(), FLAT, housings_of([other], [FLAT]))
    half = math.asin(0.1 / 1.0)
    step = 2 * math.pi / 3600
    assert (ends > 0).sum() == 2 * math.floor(half / step) + 1
    assert 1 / ends[0] == pytest.approx(0.9)
    beside = 1 / ends[1] - 0.9  # half a step of an arc further off
    assert 0 < beside < 1e-4


def test_a_level_beam_passes_over_by_a_millimetre_and_ends_a_millimetre_lower():
    low = Mount(z=-0.051, x=0.5)
    assert ends_of(Mount(), FLAT, housings_of([low], [FLAT])).max(initial=0) == 0
    flush = housings_of([Mount(z=-0.05, x=0.5)], [FLAT])
    assert ends_of(Mount(), FLAT, flush).max(initial=0) == 0
    assert ends_of(Mount(), FLAT, housings_of([Mount(z=-0.049, x=0.5)], [FLAT])).max() > 2


def test_who_sits_in_another_sees_nothing():
    inside = [Mount(), Mount(z=0.04)]
    ends = ends_in_rig(Placement("both", inside, FLAT))
    assert all(np.isinf(own).all() for own in ends)
    assert ends_of(Mount(z=0.05), FLAT, housings_of([Mount()], [FLAT])).max(initial=0) == 0


def test_own_housing_and_unknown_sizes_hide_nothing():
    (alone,) = ends_in_rig(Placement("one", [Mount()], FLAT))
    assert alone is NO_ENDS
    unknown = replace(FLAT, size=None)
    rig = Placement("two", [Mount(), Mount(x=0.5)], [FLAT, unknown])
    assert [len(own) for own in ends_in_rig(rig)] == [0, FLAT.rays]


def test_who_cannot_be_met_costs_nothing():
    level = sized([-5, 0, 5])
    others = [Mount(z=1), Mount(z=-1), Mount(x=-1), Mount(x=300), Mount(x=1)]
    housings = housings_of(others, [level] * len(others))
    ahead = replace(level, azimuth=(-0.5, 0.5))
    assert in_view(Mount(), ahead, housings)[:, 0].tolist() == [4]
    assert in_view(Mount(), level, housings)[:, 0].tolist() == [2, 4]
    assert in_view(Mount(yaw=math.pi), ahead, housings)[:, 0].tolist() == [2]
    assert ends_of(Mount(), level, housings[:2]) is NO_ENDS


CAR = np.array([[12.0, 0.0, 0.8, 1.0, 1.0, 1.6, 0.0]])
LOG = log_of((0, "Car", 12.0, 0.0, 1.0, 1.0, 1.6, 0.0))
RIG = Placement(
    "two", [Mount(z=1.7), Mount(x=0.5, z=1.7)], sized(np.linspace(-12, 0, 13), 3600, range=50.0)
)
BLIND = replace(RIG, lidar=replace(RIG.lidar, size=None))
CROP = (1.0, -5.0, 0.05, 20.0, 5.0, 3.0)


def test_clouds_lack_what_is_behind_another_lidar():
    hidden, free = (collect(LOG, [0], rig, CROP, vehicle=NOTHING) for rig in (RIG, BLIND))
    assert hidden.counts[0, 1] == free.counts[0, 1]  # the front one sees past the rear one
    behind = RIG.mounts[0]
    ends = ends_in_rig(RIG)[0]
    cloud = free[0][: free.counts[0, 0], :3]
    seen = (cloud - behind.position) / np.linalg.norm(cloud - behind.position, axis=1)[:, None]
    directions = RIG.lidars[0].directions()
    near = np.argmax(seen @ directions[ends > 0].T, axis=1)
    met = (seen * directions[ends > 0][near]).sum(axis=1) > math.cos(2e-4)
    assert met.sum() > 20
    assert hidden.counts[0, 0] == free.counts[0, 0] - met.sum()


def test_requirements_count_what_is_left():
    each = [(0,), (1,)]
    hidden, free = (
        count_points(sights_of(rig, NOTHING), CAR, sets=each)[0] for rig in (RIG, BLIND)
    )
    assert hidden[1] == free[1]
    ends, lidar = ends_in_rig(RIG)[0], RIG.lidars[0]
    directions = lidar.directions()
    # By slabs: the ray enters the box before any other of its faces.
    with np.errstate(divide="ignore", invalid="ignore"):
        times = (
            CAR[0, :3] + np.array([-0.5, 0.5])[:, None, None] * CAR[0, 3:6] - RIG.mounts[0].position
        ) / directions
    met = np.nanmax(times.min(axis=0), axis=1) < np.nanmin(times.max(axis=0), axis=1)
    assert free[0] == met.sum()
    assert hidden[0] == (met & (ends == 0)).sum() < met.sum()


def test_expected_recall_knows_the_rig_and_casts_equal_mounts_once(monkeypatch):
    from lidarplace.recall import counted_objects

    roi = Roi((0, 20), (-5, 5), (0, 3), 1.0)
    model = ExpectedRecall.from_log(LOG, roi, ["Car"], default_curves(), vehicle=NOTHING)
    jobs, cast = [], counted_objects.surface_cells
    monkeypatch.setattr(
        counted_objects, "surface_cells", lambda *job: jobs.append(job) or cast(*job)
    )
    far = Placement("far", [RIG.mounts[0], Mount(x=0.5, z=2.7)], RIG.lidar)
    high = Placement("high", [RIG.mounts[0], Mount(x=0.5, z=3.2)], RIG.lidar)
    rigs = [RIG, BLIND, far, high]
    points = [int(seen.points[0]) for seen in model.objects.seen_by(rigs)]
    assert points[0] < points[1]
    assert len(jobs) == 7  # RIG's rear one is hidden; those of `far` and `high` are alike
    expected = [int(count_points(sights_of(rig, NOTHING), CAR)[0, 0]) for rig in (RIG, BLIND)]
    hidden = [1 - seen[0] / seen[1] for seen in (points, expected)]  # a car does not fill its box
    assert hidden[0] == pytest.approx(hidden[1], rel=0.3)


def test_body_share_counts_the_rays_that_end_at_others():
    for number, (mount, lidar) in enumerate(zip(RIG.mounts, RIG.lidars, strict=True)):
        others = without(housings_of(RIG.mounts, RIG.lidars), number)
        share = body_share(mount, lidar, NOTHING, lidar.azimuth_steps, others)
        shifted = replace(mount, yaw=mount.yaw + math.pi / lidar.azimuth_steps)
        # It looks at the middles of azimuth steps, so a LiDAR turned by half a step is the same.
        assert share == pytest.approx((ends_of(shifted, lidar, others) > 0).mean(), abs=1e-3)
        assert share > 0.01
        assert body_share(mount, lidar, NOTHING, others=others[:0]) == 0
    others = housings_of(RIG.mounts, RIG.lidars)[1:]
    near = replace(RIG.lidars[0], range=0.39)
    assert body_share(RIG.mounts[0], near, NOTHING, others=others) == 0
    assert body_share(RIG.mounts[1], near, NOTHING, others=others) == 1  # inside of it


def test_near_field_and_a_dead_lidar_that_still_hides():
    wall = sized([89.0], size=(0.02, 6.0, 6.0))
    seeing = replace(sized(np.linspace(-80, 80, 60)), size=None)
    rig = Placement("two", [Mount(z=1.0), Mount(x=1.0, z=1.0)], [seeing, wall])
    behind, before = Roi((1.5, 2.5), (-0.5, 0.5), (0, 1), 0.5), Roi((-2, 0), (-1, 1), (0, 1), 0.5)
    for roi, left, share in ((behind, (0, 1), 0), (before, (0, 1), 1), (behind, (0,), 0)):
        seen, counted = seen_in_columns(rig, NOTHING, roi, [left])
        assert seen.sum() == share * counted.sum()
    open_rig = replace(rig, lidar=[seeing, replace(wall, size=None)])
    for left, share in ((0, 1), 1), ((1,), 0):
        seen, counted = seen_in_columns(open_rig, NOTHING, behind, [left])
        assert seen.sum() == share * counted.sum()
    assert counted.sum() > 0


def test_sizes_come_from_the_catalogue():
    assert Lidar.named("vlp16").size == pytest.approx((0.1033, 0.1033, 0.0717))
    assert Lidar.paper().size is None
    for size in ((0.1, 0.1), (0.1, 0.1, 0.0), (0.1, math.nan, 0.1)):
        with refused(("", "size", str(size))):
            Lidar((0.0,), 4, size=size)
