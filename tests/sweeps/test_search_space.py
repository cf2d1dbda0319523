"""Parameters to rigs and back."""

import math

import numpy as np
import optuna
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount
from lidarplace.mounting.zone import distance
from lidarplace.rigs.pose import rotation
from sweeps.configuration.search import SearchSettings
from sweeps.search.problem.families import family_params
from sweeps.search.problem.rig import MountedLidar, is_possible, mirrored, ordered, rounded
from sweeps.search.problem.slots import Assignment
from sweeps.search.problem.space import Space, assign_to_slots, rig_of
from tests.refused import refused

SHAPE = [[-1, -0.6], [0.5, -0.6], [0.8, 0], [0.5, 0.6], [-1, 0.6]]
ROOF = {"polygon": SHAPE, "z": [1.8, 2.2], "standoff": None}
NOSE = {"x": [2.1, 2.3], "y": [-0.5, 0.5], "z": 0.6}


def space_of(models=("lidar",), fixed=(), **changes) -> Space:
    values = {"zones": {"roof": ROOF}, "roll_deg": [-20, 20], "yaw_deg": [-90, 90]} | changes
    values["zones"] = {name: {"standoff": None} | zone for name, zone in values["zones"].items()}
    return Space(SearchSettings.model_validate(values), models, fixed)


def random_rig(space: Space, seed: int):
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed))
    trial = study.ask()
    rig = space.suggest(trial)
    return rig, trial.params


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31), number=st.integers(1, 9), symmetric=st.booleans())
def test_families_are_rigs_of_the_space(seed, number, symmetric):
    changes = {"zones": {"roof": ROOF, "nose": NOSE}, "lidars": [1, number], "pitch_deg": [-9, 9]}
    space = space_of(models=("a", "b"), symmetric=symmetric, **changes)
    models = dict.fromkeys(("a", "b"), Lidar.paper())
    params = family_params(space, models, 24, seed)
    for parameters in params:
        spans = space.distributions(space.counts_per_zone(parameters))
        assert parameters.keys() - space.count_ranges.keys() == spans.keys()
        assert all(s._contains(s.to_internal_repr(parameters[key])) for key, s in spans.items())
    sizes = [len(space.rig(parameters)) for parameters in params]
    assert set(sizes) == set(range(1, number + 1))
    assert family_params(space, models, 12, seed) == params[:12], "more continue fewer"


def test_families_interleave_rings_and_roll_outwards():
    zone = {"x": [-0.5, 0.5], "y": [-0.6, 0.6], "z": [2.0, 3.0]}
    space = space_of(zones={"roof": zone}, lidars=4, pitch_deg=[-9, 9])
    rigs = [space.rig(lidar) for lidar in family_params(space, {"lidar": Lidar.paper()}, 64, 0)]
    pitches = [sorted(math.degrees(lidar.mount.pitch) for lidar in rig) for rig in rigs]
    steps = np.diff(pitches)
    assert np.ptp(steps, axis=1).max() < 0.02, "the same step between all"
    assert {round(step, 2) for step in steps.mean(axis=1)} == {0.0, 0.25, 0.5, 1.0, 2.0}
    for rig in rigs:
        sides = {np.sign(lidar.mount.y) * round(math.degrees(lidar.mount.roll)) for lidar in rig}
        assert len(sides - {0.0}) <= 1, "left and right alike"


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31), number=st.integers(1, 12), symmetric=st.booleans())
def test_all_values_of_parameters_are_rigs_in_the_zones(seed, number, symmetric):
    two = {"models": ("a", "b"), "zones": {"roof": ROOF, "nose": NOSE}}
    space = space_of(lidars=number, symmetric=symmetric, **two)
    rig, params = random_rig(space, seed)
    assert len(rig) == number
    zones = {zone.name: zone for zone in space.zones}
    for lidar in rig:
        mount = lidar.mount
        assert lidar.model in ("a", "b")
        assert distance(zones[lidar.zone], mount.x, mount.y, mount.z) <= 0.001
        assert abs(mount.roll) <= math.radians(20) + 1e-4
        assert mount.pitch == 0
    if symmetric:
        assert rig == ordered(MountedLidar(own.model, own.zone, mirrored(own.mount)) for own in rig)
    assert space.rig(params) == rig


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31), symmetric=st.booleans(), number=st.integers(1, 4))
def test_parameters_of_a_rig_give_it_back(seed, symmetric, number):
    space = space_of(zones={"roof": ROOF, "nose": NOSE}, lidars=[1, 4], symmetric=symmetric)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed))
    study.enqueue_trial({"lidars": number})
    rig = space.suggest(study.ask())
    left = [m for m in rig if not symmetric or m.mount.y > 0]
    centre = [m for m in rig if symmetric and m.mount.y == 0]
    if symmetric and (len(left) != number // 2 or len(centre) != number % 2):
        return  # a pair on the centre line
    slots = space.slots((number,))
    placed = list(map(Assignment, slots, [*left, *centre]))
    again = space.rig(space.params(placed))
    for one, other in zip(again, rig, strict=True):
        assert (one.model, one.zone) == (other.model, other.zone)
        for axis in ("x", "y", "z", "roll", "yaw"):
            a, b = getattr(one.mount, axis), getattr(other.mount, axis)
            assert a == pytest.approx(b, abs=2e-3)


def test_what_cannot_vary_is_no_parameter():
    fixed_point = {"point": {"x": 0, "y": 0.1, "z": 2}}
    space = space_of(zones=fixed_point, roll_deg=5, yaw_deg=0, lidars=1)
    assert space.distributions((1,)) == {}
    rig, params = random_rig(space, 0)
    assert params == {}
    roll = round(5 * math.pi / 180, 4)
    assert rig == (MountedLidar("lidar", "point", Mount(0, 0.1, 2, roll=roll)),)


def test_rigs_that_differ_in_order_are_one():
    a, b = MountedLidar("m", "z", Mount(x=1, z=2)), MountedLidar("m", "z", Mount(x=-1, z=2))
    assert ordered([a, b]) == ordered([b, a])
    assert hash(ordered([a, b])) == hash(ordered([b, a]))
    assert str(mirrored(Mount(z=2))) == str(Mount(z=2)), "no negative zeros"
    assert not is_possible(ordered([a, a]))
    assert not is_possible(())
    assert is_possible(ordered([a, b]))


def test_the_number_of_lidars_is_a_parameter_and_fixed_ones_are_in_every_rig():
    nose = MountedLidar("lidar", "", Mount(x=2.3, z=0.6))
    space = space_of(lidars=[2, 3], fixed=[nose])
    rigs = [random_rig(space, seed)[0] for seed in range(20)]
    assert {len(rig) for rig in rigs} == {3, 4}
    assert all(nose in rig for rig in rigs)
    assert "lidar_3.x" not in space.distributions((2,))


def test_symmetry_needs_room():
    right = {"right": {"x": [0, 1], "y": [-0.6, -0.2], "z": 2}}
    for zones in (right, {"roof": {"x": [0, 1], "y": [-0.2, 0.6], "z": 2}}):
        with refused(("", "search.symmetric", "")):
            space_of(zones=zones, lidars=2, symmetric=True)
    left = {"left": {"x": [0, 1], "y": [0.2, 0.6], "z": 2}}
    space_of(zones=left, lidars=2, symmetric=True)
    space_of(zones=left | right, lidars=2, symmetric=True)


CORNERS = {
    "roof": {**ROOF, "lidars": [1, 2], "models": ["spinning"], "pitch_deg": [0, 5]},
    "corner": {"x": [2.2, 2.3], "y": [0.8, 0.9], "z": [0.5, 0.8], "lidars": 1}
    | {"models": ["flash", "small"], "mirrored": True, "facing_deg": 135, "yaw_deg": [-60, 60]},
    "tail": {"x": -2.4, "y": 0, "z": 0.7, "lidars": [0, 1], "facing_deg": 180, "yaw_deg": 0},
}


def cornered(**changes) -> Space:
    models = {"spinning": {}, "flash": {"beams": 32}, "small": {"price": 2}}
    values = {"zones": CORNERS, "models": models, "roll_deg": [-20, 20]} | changes
    return Space(SearchSettings.model_validate(values), tuple(models), ())


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31))
def test_zones_have_their_own_numbers_models_and_angles(seed):
    space = cornered()
    rig, params = random_rig(space, seed)
    by_zone = {name: [lidar for lidar in rig if lidar.zone == name] for name in CORNERS}
    assert 1 <= len(by_zone["roof"]) <= 2
    assert {lidar.model for lidar in by_zone["roof"]} == {"spinning"}
    assert all(0 <= lidar.mount.pitch <= math.radians(5) + 1e-4 for lidar in by_zone["roof"])
    right, left = sorted(by_zone["corner"], key=lambda lidar: lidar.mount.y)
    assert left.model == right.model != "spinning"
    assert mirrored(left.mount) == right.mount
    off = math.remainder(left.mount.yaw - math.radians(135), math.tau)
    assert abs(off) <= math.radians(60) + 1e-4
    assert all(
        abs(lidar.mount.yaw) == pytest.approx(math.pi, abs=1e-4) for lidar in by_zone["tail"]
    )
    assert space.numbers == (3, 5)
    assert space.rig(params) == rig
    placed = assign_to_slots(space, [MountedLidar(lidar.model, "", lidar.mount) for lidar in rig])
    assert rig_of(placed, space) == rig
    again = space.rig(space.params(placed))
    for one, other in zip(again, rig, strict=True):
        assert (one.model, one.zone) == (other.model, other.zone)
        assert one.mount.position == pytest.approx(other.mount.position, abs=2e-3)


def test_a_heading_is_the_same_after_a_full_turn():
    space = cornered()
    roof = Mount(0, 0.1, 2, pitch=0.05)
    corner = Mount(2.2, 0.8, 0.6, yaw=math.radians(190 - 360))
    lidars = [MountedLidar("", "", mount) for mount in (roof, corner, mirrored(corner))]
    placed = assign_to_slots(space, lidars)
    assert [place.lidar.model for place in placed] == ["spinning", "flash"]
    mounts = {lidar.mount for lidar in space.rig(space.params(placed)) if lidar.zone == "corner"}
    assert {round(math.degrees(mount.yaw)) for mount in mounts} == {-170, 170}


@given(st.tuples(*[st.floats(-2.5 * math.tau, 2.5 * math.tau)] * 3))
def test_angles_of_a_search_may_pass_a_turn(angles):
    mount = rounded(0, 0, 2, *angles)
    np.testing.assert_allclose(mount.rotation, rotation(*angles), rtol=0, atol=2e-4)


def test_a_rig_that_the_zones_have_no_room_for_is_refused():
    space = cornered()
    level = [Mount(x, 0.1, 2) for x in (-0.3, 0.0, 0.3)]
    with refused("a LiDAR at"):
        assign_to_slots(space, [MountedLidar("", "", mount) for mount in level])
    with refused("more or fewer LiDARs"):
        assign_to_slots(space, [MountedLidar("", "", level[0])])
