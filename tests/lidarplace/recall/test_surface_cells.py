"""Cells and points on objects, compared with rays and sets of plain Python."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given

from lidarplace import Mount, Placement
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.logs.boxes import BUILDING_COLUMNS
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.recall.surface_cells import slices_of
from tests.lidarplace.from_a_car import cast
from tests.lidarplace.recall.small_scenes import (
    CURVES,
    LIDAR,
    MOUNTS,
    ROI,
    ROWS,
    cells_hit,
    decoded,
    log_of,
    model_of,
    rows_of_cells,
    table_of,
)
from tests.refused import refused


@pytest.mark.parametrize("mounts", [MOUNTS[:1], MOUNTS[1:], MOUNTS])
def test_cells_and_points_are_those_of_plain_rays(mounts):
    model = model_of()
    seen = model.objects.seen_by([Placement("rig", mounts, lidar=LIDAR)])[0]
    geometry = model.objects.geometry
    expected, points = [], []
    for frame in (0, 3):
        of_frame = model.objects.table["frame"].to_numpy() == frame
        boxes = geometry[of_frame].tolist()
        cells, counts = cells_hit(boxes, mounts, LIDAR, model.objects.cell, ROI)
        expected, points = expected + cells, points + counts
    assert decoded(seen, slices_of(geometry, model.objects.cell)) == expected
    assert seen.points.tolist() == points
    assert min(len(cells) for cells in expected) > 3
    assert seen.counts().tolist() == [len(cells) for cells in expected]


def test_objects_that_do_not_count_hide_others():
    alone, both = model_of(classes=["Bus"]).objects, model_of().objects
    rig, bus = Placement("rig", MOUNTS, lidar=LIDAR), (both.table["class"] == "Bus").to_numpy()
    counts = both.seen_by([rig])[0].counts()[bus]
    assert alone.seen_by([rig])[0].counts().tolist() == counts.tolist()


def test_buildings_the_own_body_and_range_hide():
    tram = (0, "Tram", 15.0, 0.0, 3.0, 1.0, 1.2, 0.0)
    wall = pd.DataFrame([("a", 8.0, 0.0, 0.8, 0.5, 6.0, 1.6, 0.0)], columns=BUILDING_COLUMNS)
    free = model_of(tram, classes=["Tram"])
    walled = ExpectedRecall.from_log(log_of(tram, buildings=wall), ROI, ["Tram"], CURVES)
    high, low = Mount(z=3.5), Mount(x=2.5, z=1.0)

    def cells(model, mount, lidar=LIDAR):
        return model.objects.seen_by([Placement("one", [mount], lidar=lidar)])[0].counts()[0]

    assert cells(free, high) > 0
    assert cells(free, low) > 0
    assert cells(walled, high) > 0
    assert cells(walled, low) == 0
    assert cells(free, Mount(x=-4.0, z=0.7)) == 0  # through the vehicle
    near = LIDAR.__class__(LIDAR.elevations, LIDAR.azimuth_steps, range=10.0)
    assert cells(free, high, near) == 0


@pytest.mark.parametrize(
    "limits",
    [
        {"min_range": 9.0},
        {"range_10": 8.0},
        {"range_10": 10.0, "extinction": 0.01},
        {"range": 30.0, "extinction": 0.13, "window": 0.9},
    ],
)
def test_what_returns_no_light_is_not_hit(limits):
    log, limited = log_of(*ROWS), replace(LIDAR, **limits)
    model = model_of()
    mount, surroundings = MOUNTS[0], Surroundings(log, 0)
    expected, all_hits = [], 0
    for frame in (0, 3):
        hits = cast(mount, LIDAR, surroundings.parts(frame, 100.0))
        points = mount.position + hits.range[:, None] * (LIDAR.directions() @ mount.rotation.T)
        with np.errstate(invalid="ignore"):
            inside = np.all([ROI.x[0], ROI.y[0], ROI.z[0]] <= points, axis=1)
            inside &= np.all(points <= [ROI.x[1], ROI.y[1], ROI.z[1]], axis=1)
        on_object = inside & (hits.target >= 0)
        near_enough = hits.range <= limited.sight(hits.reflected)
        seen = on_object & near_enough & (hits.range >= limited.min_range)
        rows = len(surroundings.rows(frame))
        expected += np.bincount(hits.target[seen], minlength=rows).tolist()
        all_hits += on_object.sum()
    rig = Placement("one", [mount], lidar=limited)
    assert model.objects.seen_by([rig])[0].points.tolist() == expected
    assert 5 < sum(expected) < all_hits - 5


def test_an_object_around_the_sensor_is_seen_from_outside_alone():
    around = (0, "Bus", 0.5, 0.0, 8.0, 8.0, 3.8, 0.0)
    model = model_of(around, ROWS[0])
    assert model.objects.table["class"].tolist() == ["Tram"]  # no ideal sensor sees it from inside
    lone = model_of(ROWS[0], classes=["Tram"])
    rig = Placement("rig", MOUNTS, lidar=LIDAR)
    seen = [own.objects.seen_by([rig])[0].cells.tolist() for own in (model, lone)]
    assert seen[0] == seen[1]
    inside = Placement("inside", [Mount(12.0, 1.0, 0.8)], lidar=LIDAR)
    assert lone.objects.seen_by([inside])[0].counts().tolist() == [0]


def test_a_box_without_a_size_has_one_cell_and_a_huge_one_is_refused():
    assert slices_of(np.zeros((1, 7)), 0.2).tolist() == [[1, 1, 1]]
    flat = np.array([[0, 0, 0, 0.6, 0.2, 0.0, 0]])
    assert slices_of(flat, 0.2).tolist() == [[3, 1, 1]]
    with refused(("", "", "1e+12 of 0.1 m")):
        slices_of(np.array([[0, 0, 0, 1000.0, 1000.0, 1000.0, 0]]), 0.1)


@given(rows_of_cells, rows_of_cells)
def test_unions_are_those_of_sets(left, right):
    union = [a | b for a, b in zip(left, right, strict=True)]
    one, other = table_of(left), table_of(right)
    both = one.and_(other)
    assert both.cells.tolist() == table_of(union).cells.tolist()
    assert both.offsets.tolist() == table_of(union).offsets.tolist()
    assert both.points.tolist() == (one.points + other.points).tolist()
