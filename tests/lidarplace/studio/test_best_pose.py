"""The best pose keeps what the rig has kept: constraints, price, power and requirements."""

import math

import numpy as np
import pytest

from lidarplace import Mount, Placement
from lidarplace.studio.best_pose import KeptLimits
from lidarplace.studio.rig import posed
from tests.lidarplace.requirements.brute_force import hits_of
from tests.lidarplace.studio import rigs

NEAR = {
    "name": "somebody ahead",
    "where": {"x": [2.5, 3.5], "y": [-0.6, 0.6]},
    "what": {"length": 0.5, "width": 0.5, "height": 1.0, "headings": 1},
    "at_least": {"points": 4},
    "step": 0.5,
}
RIGS = {
    "lidar": {"beams": 6, "elevation_deg": [-20, 5], "azimuth_steps": 360},
    "placements": {"one": {"mounts": [{"x": 0.5, "z": 1.8, "pitch_deg": 20.0}]}},
    "zones": {"roof": {"x": [-1, 0.8], "y": [-0.7, 0.7], "z": [1.6, 2.0], "standoff": 0.5}},
}
"""Its nose is far down: it sees what is near, and hardly the cars."""


DARK = NEAR | {"name": "in black", "what": NEAR["what"] | {"reflectivity": 0.05}}


def studio_of(folder, **keys):
    return rigs.studio_of(folder, RIGS | keys, (10.0, 2.0), (-12.0, -2.0))


def fewest_points(studio, layout):
    """Count the fewest points at a position of a requirement, ray by ray."""
    places = ([x, y, 0.5, 0.5, 0.5, 1.0, 0.0] for x, y in layout.positions.points.tolist())
    return min(len(hits_of(studio.placement, studio.file.body, at)[0]) for at in places)


def test_an_improvement_keeps_a_requirement_that_was_met(tmp_path):
    limited = studio_of(tmp_path, requirements=[NEAR])
    (layout,) = limited.file.layouts
    assert fewest_points(limited, layout) >= 4
    best = limited.improve(0)
    assert best.after == limited.numbers().mean_recall > best.before
    assert fewest_points(limited, layout) >= 4
    assert not limited.violations()
    assert best.broken == ("somebody ahead",)
    free = studio_of(tmp_path)
    assert free.improve(0).after > best.after
    assert free.numbers().mean_recall > limited.numbers().mean_recall
    assert fewest_points(free, layout) < 4


def test_improving_finds_more_within_the_limits(studio):
    studio.pose(0, x=0.9, y=0.6, z=1.6, roll=0.0, pitch=-30.0, yaw=0.0)
    before, other = studio.numbers().expected_recall["Car"], studio.rig.pose(1)
    best_pose = studio.improve(0)
    assert best_pose.before == before
    assert best_pose.after == studio.numbers().expected_recall["Car"] > before
    assert studio.rig.pose(1) == other
    assert not studio.violations()
    assert studio.undo()
    assert studio.rig.pose(0)["pitch"] == -30.0


def test_one_more_goes_where_it_finds_most(studio):
    """Compare with all level poses of a grid in the zone, with all rays."""
    before = studio.numbers().mean_recall
    levels = [
        Mount(x, y, z)
        for x in np.linspace(-1, 1, 5)
        for y in np.linspace(-0.7, 0.7, 5)
        for z in (1.6, 2.0)
        if math.hypot(x - 0.1, y - 0.6) > 0.2 < math.hypot(x, y + 0.6)
    ]
    rigs = [
        Placement("level", [*studio.rig.mounts, mount], studio.file.lidar.lidar())
        for mount in levels
    ]
    best = max(studio.meter.measure(rig).mean_recall for rig in rigs)
    addition = studio.add_best()
    assert addition.before == before
    assert addition.after == studio.numbers().mean_recall > before
    assert addition.after >= best - 1e-3  # the search is local
    assert len(studio.rig.lidars) == 3
    assert not [v for v in studio.violations() if v.limit != "price"]
    assert studio.undo()
    assert len(studio.rig.lidars) == 2
    studio.add_best("vlp16")
    assert studio.rig.lidars[2].model == "vlp16"


def test_the_best_place_is_within_the_limits_or_there_is_none(tmp_path):
    far = "zones: {roof: {x: 0, y: 0, z: 2, standoff: 0.5}}\n"
    studio = rigs.studio_of(tmp_path, far)
    studio.add_best()
    assert (studio.rig.mounts[0].position == [0, 0, 2]).all()
    free = rigs.studio_of(tmp_path, "")
    free.add_best("at128")  # looks forward alone, and there the car is
    assert free.numbers().mean_recall > 0
    assert abs(free.rig.pose(0)["yaw"]) < 90
    assert not free.violations()


def test_the_best_pose_has_the_angles_of_its_zone(tmp_path):
    roof = {"x": [-1, 1], "y": [-0.5, 0.5], "z": [1.7, 2], "standoff": 0.5}
    roof |= {"roll_deg": 0, "pitch_deg": [2.25, 4.0], "yaw_deg": [170, 190]}
    studio = studio_of(tmp_path, zones={"roof": roof})
    for _ in range(2):
        studio.add_best()
    pose = studio.improve(0).mount
    roll, pitch, yaw = np.degrees([pose.roll, pose.pitch, pose.yaw])
    assert roll == 0
    assert 2.25 - 1e-9 <= pitch <= 4.0
    assert abs(yaw) >= 170 - 1e-9
    assert "turn" not in {one.limit for one in studio.violations()}


def test_what_is_broken_already_stands_in_nobodys_way(tmp_path):
    never = NEAR | {"at_least": {"points": 900}}
    limited, free = studio_of(tmp_path, requirements=[never]), studio_of(tmp_path)
    best = limited.improve(0)
    assert best.broken == ()
    assert free.improve(0).mount == best.mount


def test_one_more_lidar_stays_within_price_and_power(tmp_path):
    prices = {"vlp16": 4.0, "pandar40p": 12.0}
    limits = {"constraints": {"price": 10.0}, "prices": prices, "lidar": "vlp16"}
    studio = studio_of(tmp_path, **limits)
    with pytest.raises(ValueError, match="too much: price 16: 6 above 10"):
        studio.add_best("pandar40p")
    assert len(studio.rig.lidars) == 1
    studio.add_best()
    assert studio.totals()["Price"] == 8.0
    with pytest.raises(ValueError, match="price 12: 2 above 10"):
        studio.add_best()


def test_one_more_lidar_that_cannot_be_asked_does_not_keep_what_was_met(tmp_path):
    with_light = {"x": 0.5, "z": 1.8, "pitch_deg": 20.0, "lidar": {"range_10": 60.0}}
    studio = studio_of(tmp_path, requirements=[DARK], placements={"one": {"mounts": [with_light]}})
    assert not studio.violations()
    with pytest.raises(ValueError, match=r"no pose .* keeps the limits .* and that keeps in black"):
        studio.add_best()  # of the file's model, of which no range_10 is known
    assert len(studio.rig.lidars) == 1


def test_a_constraint_of_another_lidar_is_kept_as_well(tmp_path):
    mounts = [{"x": 0.5, "z": 1.8}, {"x": -0.5, "z": 1.8}]
    studio = studio_of(
        tmp_path,
        placements={"two": {"mounts": mounts}},
        constraints={"distance": 0.5},
        keep_out={"rack": {"x": [-0.2, 0.2], "y": [-1, 1], "z": [1.6, 1.9]}},
    )
    limits, rig = KeptLimits(studio.rig, studio.file), studio.rig
    assert limits.broken_by(rig) == ()
    assert limits.broken_by(posed(rig, 0, x=0.1)) == ("keep_out",)
    assert limits.broken_by(posed(rig, 0, x=-0.3, z=1.95)) == ("distance",)
    assert limits.broken_by(posed(rig, 0, x=3.0)) == ("zone",)
    late = KeptLimits(posed(rig, 0, x=3.0), studio.file)
    assert late.broken_by(posed(rig, 0, x=4.0)) == ()  # was broken before


def test_a_zone_between_millimetres_has_its_own_place(tmp_path):
    rail = {"rail": {"x": 0.12345, "y": [-0.5, 0.5], "z": 1.7}}
    studio = studio_of(tmp_path, zones=rail, placements={"empty": {}})
    studio.add_best()
    assert studio.rig.pose(0)["x"] == 0.12345
    assert not studio.violations()


def test_a_lidar_that_cannot_be_asked_gets_a_line_and_the_rest_is_judged(tmp_path):
    fog = NEAR | {"name": "in fog", "also_when": {"range_factor": 0.001}}
    mounts = [
        {"x": 0.5, "z": 1.8, "pitch_deg": 20.0},
        {"y": 0.5, "z": 1.8, "lidar": {"range_10": 30.0, "min_range": 0.5}},
    ]
    requirements, two = [DARK, NEAR, fog], {"two": {"mounts": mounts}}
    studio = studio_of(tmp_path, requirements=requirements, placements=two)
    assert [one.requirement.name for one in studio.outcomes()] == ["somebody ahead"]
    reported = [(v.lidars, v.text) for v in studio.violations()]
    assert reported == [
        ((0,), "in black: what.reflectivity: LiDAR 1: has no range_10; "
               "set it, or remove this key"),
        ((1,), "in fog: also_when: LiDAR 2: min_range: expected a number within [0, range), "
               "found 0.5"),
    ]  # fmt: skip
    assert all(math.isnan(v.excess) for v in studio.violations())
    assert studio.ground("in black") is None
    studio.enable(0, False)
    assert [one.requirement.name for one in studio.outcomes()] == ["in black", "somebody ahead"]
