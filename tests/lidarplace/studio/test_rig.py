"""Rigs that are edited, written and read again."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.configuration.placement import PlacementSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.yaml import parse_yaml
from lidarplace.studio import rig as edits
from lidarplace.studio.rig import POSE, Rig
from lidarplace.studio.studio import History
from tests.refused import refused


@st.composite
def mounts(draw):
    written = {"x": draw(st.floats(-50, 50)), "y": draw(st.floats(-50, 50))}
    written["z"] = draw(st.floats(0, 50))
    for name in draw(st.sets(st.sampled_from(["roll", "pitch", "yaw"]))):
        unit, most = draw(st.sampled_from([("", 3), ("_deg", 180)]))
        written[f"{name}{unit}"] = draw(st.floats(-most, most))
    return written


@st.composite
def rigs(draw):
    written = draw(st.lists(mounts(), min_size=1, max_size=3, unique_by=lambda m: (m["x"], m["y"])))
    convention = draw(st.sampled_from([{}, {"convention": "ego"}, {"convention": "carla"}]))
    return convention | {"mounts": written}


@settings(derandomize=True)
@given(rigs())
def test_a_rig_is_the_placement_of_its_file(written):
    rig = Rig.of_written("mine", written)
    assert rig.written["mounts"] == written["mounts"]
    default = SensorSettings(range_noise=0.03, drop_off=0.1)
    placement = PlacementSettings(**written).placement("mine", default.lidar(), default.losses)
    assert rig.placement(default) == placement


@settings(derandomize=True)
@given(rigs(), st.sampled_from(POSE), st.floats(-90, 90))
def test_one_number_changes_and_no_other(written, name, value):
    value = abs(value) if name == "z" else value  # nothing is mounted below the ground
    rig = Rig.of_written("mine", written)
    after = edits.posed(rig, 0, **{name: value})
    assert after.pose(0)[name] == pytest.approx(value, abs=1e-12)
    before, now = written["mounts"][0], after.written["mounts"][0]
    changed = dict.fromkeys((name, f"{name}_deg"))
    assert before | changed == now | changed
    if before.get(name) and name in edits.ANGLES:  # radians stay radians
        assert f"{name}_deg" not in now
    elif name in edits.ANGLES and value != rig.pose(0)[name]:
        assert abs(now[f"{name}_deg"]) == abs(value)  # as it was typed, to the last bit
    mount, other = rig.mounts[0], after.mounts[0]
    for axis in set(POSE) - {name}:
        assert getattr(mount, axis) == getattr(other, axis)
    expected = math.radians(value) if name in edits.ANGLES else value
    assert getattr(other, name) == pytest.approx(expected, abs=1e-12)


@settings(derandomize=True)
@given(rigs())
def test_a_mirror_image_is_the_same_view_left_and_right_exchanged(written):
    rig = Rig.of_written("mine", written)
    if rig.pose(0)["y"] == 0:
        with pytest.raises(ValueError, match="at y = 0"):
            edits.mirrored(rig, 0)
        return
    one, other = (edits.mirrored(rig, 0).mounts[n] for n in (0, -1))
    flip = [[1, 0, 0], [0, -1, 0], [0, 0, 1]]
    assert other.rotation == pytest.approx(flip @ one.rotation @ flip, abs=1e-12)
    assert other.position == pytest.approx(flip @ one.position, abs=1e-12)


EDITS = (
    lambda rig, n: edits.posed(rig, n, x=rig.pose(n)["x"] + 1.0),
    lambda rig, n: edits.duplicated(rig, n),
    lambda rig, n: edits.removed(rig, n) if len(rig.lidars) > 1 else rig,
    lambda rig, n: edits.enabled(rig, n, not rig.lidars[n].enabled),
    lambda rig, n: edits.of_model(rig, n, "vlp16"),
    lambda rig, n: edits.added(rig, z=3.0 + n),
)


@settings(derandomize=True)
@given(rigs(), st.lists(st.tuples(st.sampled_from(EDITS), st.integers(0, 99)), max_size=12))
def test_undo_and_redo_lead_back_and_forth(written, steps):
    states = [Rig.of_written("mine", written)]
    history = History(states[0])
    for edit, number in steps:
        after = edit(history.value, number % len(history.value.lidars))
        history.do(after)
        if after != states[-1]:
            states.append(after)
    for state in states[-2::-1]:
        assert history.go(-1)
        assert history.value == state
    assert not history.go(-1)
    for state in states[1:]:
        assert history.go(1)
        assert history.value == state
    assert not history.go(1)


def test_a_drag_is_one_step():
    history = History(0)
    for value in (1, 2, 3):
        history.value = value
    history.keep()
    history.do(4)
    assert [history.go(-1), history.value, history.go(-1), history.value] == [True, 3, True, 0]
    history.value = 7  # a drag whose end never comes
    history.go(-1)
    assert history.value == 0
    assert history.go(1)
    assert history.value == 7


def test_a_disabled_lidar_is_mounted_and_sees_nothing():
    rig = Rig.of_written("mine", parse_yaml("mounts: [{z: 2}, {x: 1, z: 2}]"))
    dead = edits.enabled(rig, 0, False)
    assert dead.placement(SensorSettings()).mounts == rig.mounts[1:]
    assert dead.written == rig.written
    assert edits.enabled(dead, 1, False).placement(SensorSettings()) is None


def test_mistakes_name_the_key():
    rig = Rig.of_written("mine", {"mounts": [{"z": 2}]})
    with refused(("", "roll_deg", ""), "found 400"):
        edits.posed(rig, 0, roll=400)
    with refused(("", "lidar", ""), "did you mean vlp16"):
        edits.of_model(rig, 0, "vlp-61")
    with refused(("mounts[1]", "x", "")):
        Rig.of_written("mine", {"mounts": [{"z": 2}, {"x": "far", "z": 2}]})
