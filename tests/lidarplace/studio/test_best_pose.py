"""The best pose keeps what the rig has kept: constraints, price, power and requirements."""

import math

import pytest

from lidarplace.studio.best_pose import KeptLimits
from lidarplace.studio.rig import posed
from tests.lidarplace.requirements.brute_force import hits_of
from tests.lidarplace.studio import rigs

NEAR = {
    "name": "somebody ahead",
    "where": {"x": [2.5, 3.5], "y": [-0.6, 0.6]},
    "what": {"length": 0.5, "width": 0.5, "height": 0.8, "headings": 1},
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


def fewest_points(studio, laid):
    """Of the places of a requirement, ray by ray."""
    places = ([x, y, 0.4, 0.5, 0.5, 0.8, 0.0] for x, y in laid.positions.points.tolist())
    return min(len(hits_of(studio.placement, studio.file.body, at)[0]) for at in places)


def test_an_improvement_keeps_a_requirement_that_was_met(tmp_path):
    kept = studio_of(tmp_path, requirements=[NEAR])
    (laid,) = kept.file.layouts
    assert fewest_points(kept, laid) >= 4
    found = kept.improve(0)
    assert found.after == kept.numbers().mean_recall > found.before
    assert fewest_points(kept, laid) >= 4
    assert not kept.violations()
    assert found.broken == ("somebody ahead",)
    free = studio_of(tmp_path)
    assert free.improve(0).after > found.after
    assert free.numbers().mean_recall > kept.numbers().mean_recall
    assert fewest_points(free, laid) < 4


def test_what_is_broken_already_stands_in_nobodys_way(tmp_path):
    never = NEAR | {"at_least": {"points": 900}}
    asked, free = studio_of(tmp_path, requirements=[never]), studio_of(tmp_path)
    found = asked.improve(0)
    assert found.broken == ()
    assert free.improve(0).mount == found.mount


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
    with pytest.raises(ValueError, match=r"no pose was found .* and that keeps in black"):
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
    asked, two = [DARK, NEAR, fog], {"two": {"mounts": mounts}}
    studio = studio_of(tmp_path, requirements=asked, placements=two)
    assert [one.requirement.name for one in studio.outcomes()] == ["somebody ahead"]
    told = [(v.lidars, v.text) for v in studio.violations()]
    assert told == [
        ((0,), "in black: what.reflectivity: LiDAR 0: has no range_10; "
               "set it, or remove this key"),
        ((1,), "in fog: also_when: LiDAR 1: min_range: expected a number within [0, range), "
               "found 0.5"),
    ]  # fmt: skip
    assert all(math.isnan(v.excess) for v in studio.violations())
    assert studio.too_little("in black") is None
    studio.enable(0, False)
    assert [one.requirement.name for one in studio.outcomes()] == ["in black", "somebody ahead"]
