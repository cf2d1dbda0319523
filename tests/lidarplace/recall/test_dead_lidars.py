"""A dead LiDAR sees nothing, and hides what is behind it: against clouds without its points."""

from dataclasses import replace

import numpy as np
import pytest

from lidarplace.base.roi import Roi
from lidarplace.clouds.collect import collect
from lidarplace.mounting.errors import MountingErrors
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall import counted_objects
from lidarplace.requirements.rays_on_objects import count_points, sights_of
from lidarplace.rigs.placement import Mount, Placement
from tests.lidarplace.recall.small_scenes import CURVES, LIDAR, ROWS, log_of, model_of

NOTHING = Vehicle("nothing", np.empty((0, 2, 3)))
ROUND = replace(LIDAR, size=(0.3, 0.3, 0.3))
LONG = replace(LIDAR, size=(0.2, 0.8, 0.4), azimuth_steps=900)
MOUNTS = (Mount(0.0, 0.0, 2.2), Mount(0.6, 0.1, 2.2, yaw=0.5), Mount(1.2, -0.3, 2.1, roll=0.1))
LIDARS = (ROUND, LONG, ROUND)
CROP = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)


def dead(number):
    """The rig with a dead LiDAR, and a whole one that has it behind the others."""
    left = [n for n in range(3) if n != number]
    mounts, lidars = ([own[n] for n in left] for own in (MOUNTS, LIDARS))
    own = (MOUNTS[number], LIDARS[number])
    whole = Placement("whole", [*mounts, own[0]], [*lidars, own[1]])
    return Placement("dead", mounts, lidars, [own]), whole


def without_last(clouds, frame):
    return clouds[frame][clouds.lidar(frame) < 2]


@pytest.mark.parametrize("number", [0, 1, 2])
def test_clouds_are_those_of_the_rig_without_its_points(number):
    rig, whole = dead(number)
    for errors in (MountingErrors(), MountingErrors(0.01, 0.01)):
        found, every = (
            collect(log_of(*ROWS), [0, 3], own, CROP, seed=2, errors=errors, vehicle=NOTHING)
            for own in (rig, whole)
        )
        for frame in range(2):
            np.testing.assert_array_equal(found[frame], without_last(every, frame))
    gone = Placement("gone", rig.mounts, rig.lidars)
    more = collect(log_of(*ROWS), [0, 3], gone, CROP, vehicle=NOTHING).counts.sum()
    none = collect(log_of(*ROWS), [0, 3], rig, CROP, vehicle=NOTHING).counts.sum()
    assert more > none or number == 0, "no LiDAR looks past the rear one"


@pytest.mark.parametrize("number", [0, 1, 2])
def test_expected_recall_is_that_of_the_points_of_the_others(number):
    rig, whole = dead(number)
    log = log_of(*ROWS)
    model = model_of(vehicle=NOTHING)
    seen = model.objects.seen_by([rig])[0]
    clouds = collect(log, [0, 3], whole, CROP, vehicle=NOTHING)
    cells, points = [], []
    for box, frame in zip(model.objects.geometry, model.objects.table["frame"], strict=True):
        cloud = without_last(clouds, [0, 3].index(frame))[:, :3].astype(np.float64)
        c, s = np.cos(box[6]), np.sin(box[6])
        turned = (cloud - box[:3]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        own = turned[(np.abs(turned) <= 0.5 * box[3:6] + 5e-3).all(axis=1)]
        most = np.maximum(1, np.ceil(box[3:6] / CURVES.cell - 1e-9))
        place = np.clip(np.floor((own + box[3:6] / 2) / CURVES.cell), 0, most - 1)
        cells.append(len(np.unique(place, axis=0)) if len(own) else 0)
        points.append(len(own))
    assert sum(cells) > 100
    # Points of clouds are rounded, and with them what lies on the edge of a cell.
    np.testing.assert_allclose(seen.points, points, atol=2)
    np.testing.assert_allclose(seen.counts(), cells, atol=2)


def test_requirements_and_expected_recall_agree_on_who_hides():
    box = np.array([[12.0, 0.0, 0.8, 4.0, 6.0, 1.6, 0.0]])
    for number in range(3):
        rig, whole = dead(number)
        left = count_points(sights_of(whole, NOTHING), box, sets=[(0, 1)])
        assert count_points(sights_of(rig, NOTHING), box) == left
        roi = Roi((2, 6), (-2, 2), (0, 3), 0.5)
        (own, _), (other, _) = (seen_in_columns(r, NOTHING, roi, [(0, 1)]) for r in (rig, whole))
        np.testing.assert_array_equal(own, other)


def test_a_mount_is_cast_once_whoever_is_dead(monkeypatch):
    model = model_of(classes=["Tram"], vehicle=NOTHING)
    jobs, cast = [], counted_objects.surface_cells
    monkeypatch.setattr(
        counted_objects, "surface_cells", lambda *job: jobs.append(job) or cast(*job)
    )
    whole = Placement("whole", MOUNTS, LIDARS)
    seen = model.objects.seen_by([whole, *(dead(number)[0] for number in range(3))])
    assert len(jobs) == 3
    assert all((own.counts() <= seen[0].counts()).all() for own in seen[1:])
