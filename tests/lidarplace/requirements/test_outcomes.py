"""Verdicts: by hand, by single rays at every position, by several sensors and with dead ones, and
what must hold for every rig."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount, Placement, Roi
from lidarplace.mounting.errors import MountingErrors
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.trailer import BendingVehicle
from lidarplace.mounting.vehicle import Vehicle, with_keep_outs
from lidarplace.recall.detection_curve import DetectionCurve
from lidarplace.requirements.area import Area, grid_over, in_the_way
from lidarplace.requirements.check_requirements import check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.presets.read import preset
from lidarplace.requirements.requirement import (
    STANDARD,
    AlsoWhen,
    PlacedObject,
    Requirement,
    dead_sets,
)
from lidarplace.rigs.weather import Weather
from lidarplace.studio.blind_ground import blind_ground, counted_ground
from tests.lidarplace.requirements.brute_force import cells_of, hits_of

CAR = Vehicle.car()
NOTHING = Vehicle("nothing", np.empty((0, 2, 3)))
LIDAR = Lidar(tuple(np.radians([-50.0, -30.0, -20.0, -12.0, -6.0, -2.0, 3.0])), azimuth_steps=120)
RIG = Placement("rig", [Mount(x=0.6, y=0.4, z=1.8, roll=0.1), Mount(x=-1.0, z=1.9)], LIDAR)
FOG = Weather(visibility=1.0, rain=5.0)
PERSON = PlacedObject(0.5, 0.7, 1.7)
ALL = 1e9  # so much that all positions fail, and nothing is refined
CURVE = DetectionCurve.model_validate({"class": "Pedestrian", "iou": 0.5, "most": 0.8, "rate": 0.2})


def outcome(area, measure, least=1.0, placed=None, rig=RIG, vehicle=CAR, **wanted):
    requirement = Requirement("x", area, measure, least, placed, **wanted)
    return check_requirements([lay_out(requirement, vehicle)], rig, vehicle)[0]


# An antenna that no ray meets, and a step and a mirror.
ANTENNA = np.array([[[-3.3, 0.1, 2.6], [-2.6, 0.4, 3.0]]])
STEP = np.array([[[-3.1, -0.9, 0.0], [-2.3, 0.9, 0.4]], [[0.6, 1.1, 0.6], [0.8, 1.37, 1.2]]])
BENT = BendingVehicle("bent", CAR.boxes, None, 1, (-1.0, 0.0), (20.0,))


@pytest.mark.parametrize("body", [CAR, BENT], ids=["car", "bending"])
@pytest.mark.parametrize("area", [Area(distance=(0.2, 1.4)), "un_r158", "coverage"])
def test_keep_outs_remove_positions_and_move_none(body, area):
    def found(vehicle):
        if area == "coverage":
            volume = {"step": 0.3, "heights": (0.0, 1.0)}
            return outcome(Area(distance=(0.2, 1.4)), "coverage", vehicle=vehicle, **volume)
        where = area if isinstance(area, Area) else preset(area, vehicle)
        cube = PlacedObject(0.4, 0.4, 0.8, headings=1)
        return outcome(where, "points", placed=cube, vehicle=vehicle, step=0.3)

    with_antenna, with_step = (with_keep_outs(body, keep_out) for keep_out in (ANTENNA, STEP))
    plain, high, stepped = map(found, (body, with_antenna, with_step))
    assert high.cases == plain.cases
    np.testing.assert_array_equal(high.least_of, plain.least_of)
    points, (centre, half) = plain.positions.points, (STEP.mean(axis=1), np.ptp(STEP, axis=1) / 2)
    apart = (np.abs(points[:, None] - centre[:, :2]) >= half[:, :2] + 0.2).any(axis=2).all(axis=1)
    assert area == "coverage" or not apart.all()
    expected = points if area == "coverage" else points[apart]
    np.testing.assert_array_equal(stepped.positions.points, expected)


def test_every_position_against_single_rays():
    rig = RIG.with_lidar(Lidar(LIDAR.elevations, azimuth_steps=40))
    result = outcome(Area(distance=(0.2, 1.2)), "points", 6, PERSON, rig, share=1.0, step=1.0)
    points = result.positions.points
    by_heading = [
        [
            math.inf
            if in_the_way(CAR, np.array([[x, y]]), PERSON.size, yaw)[0]
            else sum(map(len, hits_of(rig, CAR, (x, y, 0.85, *PERSON.size, yaw))))
            for yaw in (0.0, math.pi / 4, math.pi / 2, 3 * math.pi / 4)
        ]
        for x, y in points.tolist()
    ]
    by_position = [min(counts) for counts in by_heading]
    assert result.least_of.tolist() == by_position
    worst = result.worst
    at = int(np.argmin(by_position))
    assert (worst.x, worst.y) == tuple(points[at])
    assert worst.at_worst == by_position[at]
    assert by_heading[at][round(worst.heading / (math.pi / 4))] == by_position[at]
    assert 0 < worst.enough < 1
    assert worst.value == min(by_position) < 6
    assert not result.met


def test_one_level_lidar_and_a_wall():
    """360 rays a turn, a wall 2 m wide: atan(1 / 4) is 14.04, atan(1 / 9.5) is 6.01 degrees."""
    rig = Placement("one", [Mount(z=1.0)], Lidar((0.0,), azimuth_steps=360))
    wall = PlacedObject(1.0, 2.0, 2.0, headings=1)
    area = Area(x=(4.5, 10.0), y=((0.0, 0.0),))
    result = outcome(area, "points", 14, wall, rig, NOTHING, step=5.5)
    assert result.positions.points.tolist() == [[4.5, 0.0], [10.0, 0.0]]
    assert result.least_of.tolist() == [2 * 14 + 1, 2 * 6 + 1]
    assert not result.met
    assert (result.worst.x, result.worst.value) == (10.0, 13.0)
    assert outcome(area, "points", 11, wall, rig, NOTHING, step=5.5).met
    assert outcome(area, "points", 13, wall, rig, NOTHING, step=5.5).worst.undecided


@pytest.mark.parametrize("measure", ["points", "cells", "coverage"])
def test_cases_are_rigs_on_their_own(measure):
    """Each case is the verdict on the rig that it stands for."""
    off = MountingErrors(0.05, 0.05)
    case = AlsoWhen(one_lidar_dead=True, range_factor=0.03, weather=FOG, mounts_off=off, draws=2)
    arguments = Area(distance=(0.0, 2.5)), measure, 1.0, None if measure == "coverage" else PERSON
    result = outcome(*arguments, step=0.5, also_when=case)
    shorter = (3.0, LIDAR.in_weather(FOG).reach)
    rigs = {
        "as built": RIG,
        "without LiDAR 1": Placement("left", RIG.mounts[1:], LIDAR),
        "without LiDAR 2": Placement("left", RIG.mounts[:1], LIDAR),
        "range × 0.03": RIG.with_lidar(Lidar(LIDAR.elevations, 120, range=shorter[0])),
        str(FOG): RIG.with_lidar(Lidar(LIDAR.elevations, 120, range=shorter[1])),
        "mounts off, draw 1": off.drawn(RIG, 0),
        "mounts off, draw 2": off.drawn(RIG, 1),
    }
    alone = {case: outcome(*arguments, rig, step=0.5).worst.value for case, rig in rigs.items()}
    assert [(one.case, one.value) for one in result.cases] == [*alone.items()]
    assert len({*alone.values()}) > 2
    assert result.worst.value == min(alone.values())


def test_coverage_is_that_of_the_near_field():
    area = Area(x=(-4.0, 4.0), y=((-2.5, 2.5),))
    roi = Roi((-4.0, 4.0), (-2.5, 2.5), (0.0, 1.0), 0.25)
    result = outcome(area, "coverage", step=0.25, heights=(0.0, 1.0))
    seen, counted = seen_in_columns(RIG, CAR, roi)
    assert result.worst.value == seen.sum() / counted.sum()


def test_probability_is_the_curve_of_the_cells():
    area = Area(distance=(0.5, 3.0))
    cells = outcome(area, "cells", 1, PERSON)
    result = outcome(area, "probability", 0.5, PERSON, curve=CURVE)
    assert result.least_of == pytest.approx(0.8 * (1 - np.exp(-0.2 * cells.least_of)))


def test_a_symmetric_rig_has_a_symmetric_result():
    mounts = [Mount(0.5, side * 0.6, 1.9, roll=-0.2 * side, yaw=0.4 * side) for side in (-1, 1)]
    rig = Placement("pair", mounts, LIDAR)
    for measure, placed in (("points", STANDARD["child"]), ("coverage", None)):
        result = outcome(Area(distance=(0.3, 3.0)), measure, 1.0, placed, rig, step=0.4)
        least = np.full(result.positions.held.shape, np.nan)
        least[result.positions.held] = result.least_of
        np.testing.assert_allclose(least, least[:, ::-1], rtol=1e-12)


@given(
    x=st.floats(-4, 4),
    y=st.floats(-3, 3),
    length=st.floats(0.1, 3),
    width=st.floats(0.1, 3),
    heading=st.floats(0, math.pi),
)
@settings(max_examples=100)
def test_what_is_in_the_way_shares_a_point_with_the_body(x, y, length, width, heading):
    """Against points of the object: one in the body is proof; far from it there is none."""
    size = (length, width, 1.0)
    met = in_the_way(CAR, np.array([[x, y]]), size, heading)[0]
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, 61), np.linspace(-0.5, 0.5, 61))
    c, s = math.cos(heading), math.sin(heading)
    px, py = x + c * u * length - s * v * width, y + s * u * length + c * v * width
    low, high = CAR.interior[0]
    inside = (low[0] < px) & (px < high[0]) & (low[1] < py) & (py < high[1])
    depth = np.minimum.reduce([px - low[0], high[0] - px, py - low[1], high[1] - py]).max()
    if inside.any():
        assert met
    elif depth < -0.1:  # farther apart than the points are from each other
        assert not met


def test_what_stands_above_or_below_the_body_is_not_in_the_way():
    bridge = Vehicle("bridge", np.array([[[-5.0, -5.0, 2.0], [5.0, 5.0, 3.0]]]))
    at = np.array([[0.0, 0.0]])
    assert not in_the_way(bridge, at, (1.0, 1.0, 1.9), 0.3)[0]
    assert in_the_way(bridge, at, (1.0, 1.0, 2.1), 0.3)[0]


def test_areas_of_sectors_and_lanes():
    around = grid_over(Area(distance=(0.0, 3.0)), CAR, 0.5)
    behind = grid_over(Area(distance=(0.0, 3.0), sectors=((157.5, 202.5),)), CAR, 0.5)
    points = around.points
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    assert behind.points.tolist() == points[np.abs(azimuth) >= 157.5].tolist()
    lanes = grid_over(Area(x=(-1.0, 1.0), y=((-5.25, -1.75), (1.75, 5.25))), CAR, 0.5)
    assert set(np.abs(lanes.points[:, 1])) == {1.75, 2.25, 2.75, 3.25, 3.75, 4.25, 4.75, 5.25}


FEW = Lidar(tuple(np.radians([-50.0, -30.0, -18.0, -9.0, -3.0])), azimuth_steps=60)
THREE = Placement(
    "three", [Mount(0.6, 0.4, 1.8, 0.1), Mount(-1.0, z=1.9), Mount(2.4, -0.3, 0.7, 0.0, 0.1)], FEW
)
TURNED = PlacedObject(0.5, 0.7, 1.7, headings=2)
AREA = Area(distance=(0.3, 1.5))


def of_three(rig=THREE, area=AREA, measure="points", placed=TURNED, step=1.3, **wanted):
    return outcome(area, measure, ALL, placed, rig, step=step, **wanted)


@pytest.fixture(scope="module")
def hits():
    """Return points of each LiDAR on the person, by position and heading."""
    layout = lay_out(Requirement("x", AREA, "points", 1.0, TURNED, step=1.3), CAR)
    return [
        [hits_of(THREE, CAR, box) for box in by_heading if np.isfinite(box[0])]
        for by_heading in layout.boxes.swapaxes(0, 1)
    ]


@pytest.mark.parametrize("measure", ["points", "cells", "probability"])
@pytest.mark.parametrize(("sensors", "dead"), [(1, 0), (2, 0), (3, 0), (4, 0), (1, 1), (2, 1)])
def test_several_sensors_against_single_rays(hits, measure, sensors, dead):
    def count(points):
        if measure == "points":
            return len(points)
        cells = len(cells_of(points, TURNED.size, 0.2))
        return float(CURVE.probability(np.array([cells]))[0]) if measure == "probability" else cells

    def has(of_lidars, alive):
        counts = sorted((count(of_lidars[n]) for n in alive), reverse=True)
        return counts[sensors - 1] if len(counts) >= sensors else 0

    sets = [(), *(combinations(range(3), dead) if dead else ())]
    expected = [
        [min(has(box, set(range(3)) - set(gone)) for box in boxes) for boxes in hits]
        for gone in sets
    ]
    curve = CURVE if measure == "probability" else None
    case = AlsoWhen(sensors_dead=dead)
    result = of_three(measure=measure, curve=curve, cell=0.2, sensors=sensors, also_when=case)
    assert [case.value for case in result.cases] == pytest.approx([*map(min, expected)])
    assert result.least_of == pytest.approx(np.min(expected, axis=0))
    assert result.least_of.max() > 0 or sensors + dead > 3


@pytest.mark.parametrize("measure", ["points", "cells", "coverage"])
def test_two_dead_of_three_are_the_one_that_is_left(measure):
    wanted = {"measure": measure, "placed": None if measure == "coverage" else TURNED}

    def values(**case):
        results = of_three(**wanted, also_when=AlsoWhen(**case)).cases[1:]
        return {result.case: result.value for result in results}

    alone = [of_three(Placement("one", [THREE.mounts[n]], FEW), **wanted).worst for n in (2, 1, 0)]
    pairs = [f"without LiDAR {a} and LiDAR {b}" for a, b in ((1, 2), (1, 3), (2, 3))]
    expected = dict(zip(pairs, (result.value for result in alone), strict=True))
    assert values(sensors_dead=2) == expected
    assert [*values(sensors_dead=5).values()] == [0.0]
    assert values(one_lidar_dead=True) == values(sensors_dead=1)


def test_volume_by_two_sensors_is_where_two_lidars_see_each_by_itself():
    roi = Roi((-3.0, 3.0), (-2.0, 2.0), (0.0, 0.5), 0.5)  # one layer: a column is a voxel
    each = [seen_in_columns(Placement("one", [mount], FEW), CAR, roi)[0] for mount in THREE.mounts]
    _, outside = seen_in_columns(THREE, CAR, roi)
    settings = {"area": Area(x=(-3.0, 3.0), y=((-2.0, 2.0),)), "step": 0.5, "heights": (0.0, 0.5)}
    for sensors in (1, 2, 3, 4):
        result = of_three(measure="coverage", placed=None, sensors=sensors, **settings)
        assert result.worst.value == (np.sum(each, axis=0) >= sensors).sum() / outside.sum()


def test_ground_is_counted_by_sensors():
    """A cell has as many as there are LiDARs for which, alone, it is not blind."""
    ground = counted_ground(THREE, CAR, 1.5)
    blind = [
        {tuple(at) for at in blind_ground(Placement("one", [mount], FEW), CAR, 1.5).middles}
        for mount in THREE.mounts
    ]
    expected = [sum(tuple(at) not in cells for cells in blind) for at in ground.middles]
    assert ground.sensors.tolist() == expected
    assert set(expected) == {0, 1, 2, 3}
    assert ground.share == np.mean(np.array(expected) < 2)
    assert not counted_ground(None, CAR, 1.5).sensors.any()


def test_sets_of_dead_sensors_are_bounded():
    assert dead_sets(0, 3) == [()]
    assert dead_sets(9, 2) == [(0, 1)]
    assert len(dead_sets(2, 40)) == 780
