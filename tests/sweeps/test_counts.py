"""Numbers of LiDARs in all, by zone and by model, against every combination of them."""

import itertools
import math
from collections import Counter

import numpy as np
import optuna
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount
from lidarplace.mounting.counts import most_in_zone
from lidarplace.mounting.zone import Zone
from sweeps.configuration.search import SAMPLERS, SearchSettings
from sweeps.search.problem.families import family_params
from sweeps.search.problem.rig import MountedLidar, mirrored
from sweeps.search.problem.space import Space, assign_to_slots, broken_count, rig_of
from sweeps.search.trials.samplers import Repeatable
from tests.refused import refused

X, Y, Z = [0.0, 1.0], [0.1, 1.0], [2.0, 2.5]
ZONE = {"x": X, "y": Y, "z": Z, "standoff": None}


def space_of(values) -> Space:
    zones = {name: ZONE | zone for name, zone in values["zones"].items()}
    read = SearchSettings.model_validate(values | {"zones": zones})
    return Space(read, tuple(read.models), ())


def drawn(seed):
    """Zones with bounds, models and mirrored pairs, models with bounds, and a total, at random."""
    random = np.random.default_rng(seed)
    names = ("a", "b", "c")[: random.integers(1, 4)]

    def bound(most):
        low = int(random.integers(0, most))
        return [low, int(random.integers(max(low, 1), most + 1))]

    zones = {}
    for zone in ("roof", "nose", "tail")[: random.integers(1, 4)]:
        zones[zone] = {"mirrored": bool(random.random() < 0.3)}
        if random.random() < 0.5:
            zones[zone]["lidars"] = bound(3)
        if random.random() < 0.5:
            allowed = random.permutation(names)[: random.integers(1, len(names) + 1)].tolist()
            zones[zone]["models"] = {name: {"pitch_deg": [0, 5 * len(name)]} for name in allowed}
    models = {name: {"count": bound(3)} if random.random() < 0.6 else {} for name in names}
    low = int(random.integers(1, 5))
    return {"zones": zones, "models": models, "lidars": [low, low + int(random.integers(0, 2))]}


def all_counts(values):
    """Every number of LiDARs by zone and model that keeps all bounds, by trying all."""
    zones, (low, high) = values["zones"], values["lidars"]
    kinds = [
        (zone, model)
        for zone, of_zone in zones.items()
        for model in of_zone.get("models", values["models"])
    ]
    sizes = [2 if zones[zone]["mirrored"] else 1 for zone, _ in kinds]
    kept = set()
    for numbers in itertools.product(*(range(high // size + 1) for size in sizes)):
        each = list(zip(kinds, sizes, numbers, strict=True))
        of_zone = {z: sum(n for (zone, _), _, n in each if zone == z) for z in zones}
        of_model = {
            m: sum(n * size for (_, model), size, n in each if model == m) for m in values["models"]
        }
        keeps = low <= sum(n * size for _, size, n in each) <= high
        for bounds, key, found in (
            (zones, "lidars", of_zone),
            (values["models"], "count", of_model),
        ):
            keeps &= all(
                own[key][0] <= found[name] <= own[key][1]
                for name, own in bounds.items()
                if key in own
            )
        if keeps:
            kept.add(frozenset((kind, n) for kind, _, n in each if n))
    return kept


def counts_of(rig, values):
    sizes = {zone: 2 if own["mirrored"] else 1 for zone, own in values["zones"].items()}
    counts = Counter((lidar.zone, lidar.model) for lidar in rig)
    return frozenset((kind, n // sizes[kind[0]]) for kind, n in counts.items())


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31))
def test_rigs_are_those_of_every_combination_that_keeps_all_bounds(seed):
    values = drawn(seed)
    possible = all_counts(values)
    if not possible:
        with refused("impossible with .*expected .*, found "):
            space_of(values)
        return
    space = space_of(values)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed))
    for _ in range(20):
        rig = space.suggest(study.ask())
        assert counts_of(rig, values) in possible
        assert rig_of(assign_to_slots(space, rig), space) == rig
    models = dict.fromkeys(space.models, Lidar.paper())
    for params in family_params(space, models, 16, seed):
        assert counts_of(space.rig(params), values) in possible
    for counts in possible:  # each can be reached: its parameters give it back
        rig = rig_with(counts, values)
        again = space.rig(space.params(assign_to_slots(space, rig)))
        assert counts_of(again, values) == counts
    numbers = {sum(n * (1 + values["zones"][z]["mirrored"]) for (z, _), n in c) for c in possible}
    assert space.numbers == (min(numbers), max(numbers))


def rig_with(counts, values):
    rig, ys = [], itertools.count()
    for (zone, model), number in counts:
        for _ in range(number):
            mount = Mount(0.5, 0.11 + 0.01 * next(ys), 2.2)
            rig.append(MountedLidar(model, zone, mount))
            if values["zones"][zone]["mirrored"]:
                rig.append(MountedLidar(model, zone, mirrored(mount)))
    return rig


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31))
def test_a_choice_of_parts_completes_if_a_rig_has_them(seed):
    values = drawn(seed)
    possible = all_counts(values)
    if not possible:
        return
    space, random = space_of(values), np.random.default_rng(seed)
    kinds = [(z, m) for z, own in values["zones"].items() for m in own.get("models", space.models)]
    for _ in range(10):
        counts = Counter(
            {kinds[i]: int(n) for i, n in enumerate(random.integers(0, 3, len(kinds)))}
        )
        parts = [tuple(rig_with([(kind, 1)], values)) for kind in counts.elements()]
        held = any(all(dict(c).get(kind, 0) >= n for kind, n in counts.items()) for c in possible)
        assert space.completes(parts) == held


FIVE = {
    "lidars": 5,
    "zones": {
        "roof": {"models": {"dome": {"pitch_deg": [60, 90]}, "spinner": {}}, "pitch_deg": [0, 10]},
        "corner": {"models": ["flash"], "mirrored": True, "lidars": [0, 1]},
    },
    "models": {"dome": {"count": [1, 2]}, "spinner": {"count": [1, 3]}, "flash": {"count": [1, 2]}},
}


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_every_sampler_proposes_rigs_that_keep_all_bounds(sampler):
    space, possible = space_of(FIVE), all_counts(with_defaults(FIVE))
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=Repeatable(sampler, 1))
    seen = set()
    trials = 11 if sampler == "gp" else 24  # it is slow after its first ten
    for _ in range(trials):
        trial = study.ask()
        rig = space.suggest(trial)
        counts = counts_of(rig, with_defaults(FIVE))
        seen.add(counts)
        assert counts in possible
        for lidar in rig:
            low, high = {"dome": (60, 90), "spinner": (0, 10), "flash": (0, 0)}[lidar.model]
            assert low - 0.01 <= math.degrees(lidar.mount.pitch) <= high + 0.01
        study.tell(trial, sum(lidar.mount.x for lidar in rig))
    assert seen == possible or sampler == "gp"


def with_defaults(values):
    zones = {name: {"mirrored": False} | zone for name, zone in values["zones"].items()}
    return values | {"zones": zones, "lidars": [values["lidars"]] * 2}


def test_models_of_a_start_are_chosen_so_that_the_counts_are_kept():
    space = space_of(FIVE)
    roof = [Mount(0.2 * i, 0.5, 2.2, pitch=math.radians(5)) for i in range(3)]
    corner = Mount(0.3, 0.9, 2.1)
    lidars = [MountedLidar("", "", mount) for mount in (*roof, corner, mirrored(corner))]
    with refused(("", "search.models.dome.count", "0")):
        assign_to_slots(space, lidars)  # pitched by 5 degrees, as no dome may be
    steep = [MountedLidar("", "", Mount(0.9, 0.5, 2.2, pitch=1.4)), *lidars[1:]]
    rig = rig_of(assign_to_slots(space, steep), space)
    assert Counter(lidar.model for lidar in rig) == {"dome": 1, "spinner": 2, "flash": 2}
    bound, number = broken_count(space, rig[1:])
    assert (bound.key, number) == ("models.dome.count", 0)


def test_the_room_of_a_zone():
    assert most_in_zone(Zone.box("point", (1, 1), (0, 0), (2, 2)), 0.0) == 1
    assert most_in_zone(Zone.box("line", (0, 0.6), (0, 0), (2, 2)), 0.2) == 4
    assert most_in_zone(Zone.box("box", (0, 1), (0, 1), (2, 2)), 0.0) == math.inf
    square = Zone.box("square", (0, 1), (0, 1), (2, 2))
    assert most_in_zone(square, 0.5) >= 9, "a grid of 3 x 3 fits"
