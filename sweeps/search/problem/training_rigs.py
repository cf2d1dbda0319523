"""Rigs of a search's space that its generalist is trained on."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution

from lidarplace import Lidar
from lidarplace.mounting.random_rigs import CANDIDATES
from lidarplace.mounting.ring_overlap import spread_by_overlap
from sweeps.search.problem.choice import Choices, is_possible, placement_of
from sweeps.search.problem.space import Space, within

_LEVEL = 2
"""Every so many of them are level, and half of those of one height: there rings coincide."""


def training_rigs(
    space: Space, models: Mapping[str, Lidar], number: int, seed: int
) -> dict[str, Choices]:
    """So many rigs by name, spread from those whose rings overlap least to those with the most.
    Every number of LiDARs in a zone is there as often. Constraints are not looked at: a detector
    may learn from rigs that nobody builds."""
    random = np.random.default_rng(seed)
    makeups = [makeup for makeup in space.makeups if any(makeup) or space.fixed]
    if len(makeups) > number:  # from the fewest LiDARs to the most
        makeups = [makeups[i] for i in np.linspace(0, len(makeups) - 1, number).round().astype(int)]
    found: dict[str, Choices] = {}
    for place, makeup in enumerate(makeups):
        wanted = len(range(place, number, len(makeups)))
        counts = dict(zip(space.counts, makeup, strict=True))
        drawn: list[Choices] = []
        while len(drawn) < CANDIDATES * wanted:
            turns = _drawn(space.distributions(makeup), len(drawn), random)
            rig = space.rig(counts | turns)
            if is_possible(rig):
                drawn.append(rig)
        placements = [placement_of(rig, models) for rig in drawn]
        for rig in spread_by_overlap(drawn, placements, wanted):
            found[f"generalist_{len(found) + 1}"] = rig
    return found


def rigs_near(
    space: Space, start: Sequence[Mapping[str, Any]], number: int, seed: int
) -> dict[str, Choices]:
    """So many rigs by name, each off one of `start`, parameters of rigs, which take turns, by up to
    a tenth of its zone and 5 degrees."""
    random = np.random.default_rng(seed)
    found: dict[str, Choices] = {}
    while len(found) < number:
        own = dict(start[len(found) % len(start)])
        for name, distribution in space.distributions(space.makeup(own)).items():
            if isinstance(distribution, FloatDistribution):
                reach = 5.0 if name.endswith("_deg") else 0.1
                own[name] = within(own[name] + random.uniform(-reach, reach), distribution)
        rig = space.rig(own)
        if is_possible(rig):
            found[f"generalist_{len(found) + 1}"] = rig
    return found


def _drawn(
    space: Mapping[str, BaseDistribution], count: int, random: np.random.Generator
) -> dict[str, Any]:
    """Parameters at random; some level, some of one height."""
    params: dict[str, Any] = {}
    height = float(random.uniform())
    for name, distribution in space.items():
        axis = name.rpartition(".")[2]
        if isinstance(distribution, CategoricalDistribution):
            params[name] = distribution.choices[int(random.integers(len(distribution.choices)))]
            continue
        assert isinstance(distribution, FloatDistribution)
        params[name] = float(random.uniform(distribution.low, distribution.high))
        if count % _LEVEL == 0 and axis in ("roll_deg", "pitch_deg"):
            params[name] = within(0.0, distribution)
        if count % (2 * _LEVEL) == 0 and axis == "z":
            params[name] = height
    return params
