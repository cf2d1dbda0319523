"""Seen by several sensors, and with any of them dead: against single rays and rigs of their own."""

from itertools import combinations

import numpy as np
import pytest

from lidarplace import Lidar, Mount, Placement, Roi
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import DetectionCurve
from lidarplace.requirements.area import Area
from lidarplace.requirements.judge import judge
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.requirement import AlsoWhen, PlacedObject, Requirement, dead_sets
from lidarplace.studio.blind_ground import blind_ground, counted_ground
from tests.lidarplace.requirements.brute_force import cells_of, hits_of

CAR = Vehicle.car()
LIDAR = Lidar(tuple(np.radians([-50.0, -30.0, -18.0, -9.0, -3.0])), azimuth_steps=60)
RIG = Placement(
    "three",
    [Mount(0.6, 0.4, 1.8, roll=0.1), Mount(-1.0, 0.0, 1.9), Mount(2.4, -0.3, 0.7, pitch=0.1)],
    LIDAR,
)
PERSON = PlacedObject(0.5, 0.7, 1.7, headings=2)
AREA = Area(distance=(0.3, 1.5))
CURVE = DetectionCurve.model_validate({"class": "Pedestrian", "iou": 0.5, "most": 0.8, "rate": 0.2})


def outcome(rig=RIG, **wanted):
    settings = {"area": AREA, "measure": "points", "least": 1.0, "placed": PERSON, "step": 1.3}
    return judge([lay_out(Requirement("x", **(settings | wanted)), CAR)], rig, CAR)[0]


@pytest.fixture(scope="module")
def hits():
    """Of every position and heading the points of each LiDAR on the person."""
    laid = lay_out(Requirement("x", AREA, "points", 1.0, PERSON, step=1.3), CAR)
    return [
        [hits_of(RIG, CAR, box) for box in by_heading if np.isfinite(box[0])]
        for by_heading in laid.boxes.swapaxes(0, 1)
    ]


@pytest.mark.parametrize("measure", ["points", "cells", "probability"])
@pytest.mark.parametrize(("sensors", "dead"), [(1, 0), (2, 0), (3, 0), (4, 0), (1, 1), (2, 1)])
def test_several_sensors_against_single_rays(hits, measure, sensors, dead):
    def count(points):
        if measure == "points":
            return len(points)
        cells = len(cells_of(points, PERSON.size, 0.2))
        return float(CURVE.probability(np.array([cells]))[0]) if measure == "probability" else cells

    def has(of_lidars, alive):
        found = sorted((count(of_lidars[n]) for n in alive), reverse=True)
        return found[sensors - 1] if len(found) >= sensors else 0

    sets = [(), *(combinations(range(3), dead) if dead else ())]
    expected = [
        [min(has(box, set(range(3)) - set(gone)) for box in boxes) for boxes in hits]
        for gone in sets
    ]
    curve = CURVE if measure == "probability" else None
    case = AlsoWhen(sensors_dead=dead)
    found = outcome(measure=measure, curve=curve, cell=0.2, sensors=sensors, also_when=case)
    assert [own.value for own in found.findings] == pytest.approx([min(own) for own in expected])
    assert found.least_of == pytest.approx(np.min(expected, axis=0))
    assert found.least_of.max() > 0 or sensors + dead > 3


@pytest.mark.parametrize("measure", ["points", "cells", "coverage"])
def test_two_dead_of_three_are_the_one_that_is_left(measure):
    placed = None if measure == "coverage" else PERSON
    wanted = {"measure": measure, "placed": placed}
    found = outcome(**wanted, also_when=AlsoWhen(sensors_dead=2))
    alone = [outcome(Placement("one", [RIG.mounts[n]], LIDAR), **wanted).worst for n in (2, 1, 0)]
    assert [own.case for own in found.findings] == [
        "as built",
        "without LiDAR 1 and LiDAR 2",
        "without LiDAR 1 and LiDAR 3",
        "without LiDAR 2 and LiDAR 3",
    ]
    assert [own.value for own in found.findings[1:]] == [own.value for own in alone]
    all_dead = outcome(**wanted, also_when=AlsoWhen(sensors_dead=5))
    assert [own.value for own in all_dead.findings[1:]] == [0.0]
    one, any_one = (
        outcome(**wanted, also_when=case)
        for case in (AlsoWhen(one_lidar_dead=True), AlsoWhen(sensors_dead=1))
    )
    assert one.findings == any_one.findings


def test_volume_by_two_sensors_is_where_two_lidars_see_each_by_itself():
    roi = Roi((-3.0, 3.0), (-2.0, 2.0), (0.0, 0.5), 0.5)  # one layer: a column is a voxel
    each = [seen_in_columns(Placement("one", [mount], LIDAR), CAR, roi)[0] for mount in RIG.mounts]
    _, outside = seen_in_columns(RIG, CAR, roi)
    area = Area(x=(-3.0, 3.0), y=((-2.0, 2.0),))
    for sensors in (1, 2, 3, 4):
        found = outcome(
            area=area, measure="coverage", placed=None, sensors=sensors, step=0.5,
            heights=(0.0, 0.5),
        )  # fmt: skip
        assert found.worst.value == (np.sum(each, axis=0) >= sensors).sum() / outside.sum()


def test_ground_is_counted_by_sensors():
    """A cell has as many as there are LiDARs for which, alone, it is not blind."""
    found = counted_ground(RIG, CAR, 1.5)
    blind = [
        {tuple(at) for at in blind_ground(Placement("one", [mount], LIDAR), CAR, 1.5).middles}
        for mount in RIG.mounts
    ]
    expected = [sum(tuple(at) not in own for own in blind) for at in found.middles]
    assert found.sensors.tolist() == expected
    assert set(expected) == {0, 1, 2, 3}
    assert found.share == np.mean(np.array(expected) < 2)
    assert not counted_ground(None, CAR, 1.5).sensors.any()


def test_sets_of_dead_sensors_are_bounded():
    assert dead_sets(0, 3) == [()]
    assert dead_sets(9, 2) == [(0, 1)]
    assert len(dead_sets(2, 40)) == 780
    with pytest.raises(ValueError, match="expected at most 1,000 sets of 3 dead sensors, found 1,"):
        dead_sets(3, 20)
