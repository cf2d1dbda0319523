"""Rigs of a search's space on which its generalist is trained."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution

from lidarplace import Lidar
from lidarplace.mounting.random_rigs import CANDIDATES
from lidarplace.mounting.ring_overlap import spread_by_overlap
from sweeps.search.problem.rig import Rig, is_possible, placement_of
from sweeps.search.problem.space import Space, within

_LEVEL = 2
"""Stride of level rigs; half of those have LiDARs of one height: there rings coincide."""


def training_rigs(
    space: Space, models: Mapping[str, Lidar], number: int, seed: int
) -> dict[str, Rig]:
    """Draw `number` rigs by name, from those with the least overlap of rings to the most.

    Every number of LiDARs in a zone occurs equally often. Constraints are ignored: a detector may
    learn from rigs that nobody builds."""
    random = np.random.default_rng(seed)
    all_counts = [
        counts_per_zone
        for counts_per_zone in space.all_counts
        if any(counts_per_zone) or space.fixed
    ]
    if len(all_counts) > number:  # from the fewest LiDARs to the most
        all_counts = [
            all_counts[i] for i in np.linspace(0, len(all_counts) - 1, number).round().astype(int)
        ]
    rigs: dict[str, Rig] = {}
    for place, counts_per_zone in enumerate(all_counts):
        wanted = len(range(place, number, len(all_counts)))
        counts = dict(zip(space.count_ranges, counts_per_zone, strict=True))
        drawn: list[Rig] = []
        while len(drawn) < CANDIDATES * wanted:
            turns = _drawn(space.distributions(counts_per_zone), len(drawn), random)
            rig = space.rig(counts | turns)
            if is_possible(rig):
                drawn.append(rig)
        placements = [placement_of(rig, models) for rig in drawn]
        for rig in spread_by_overlap(drawn, placements, wanted):
            rigs[f"generalist_{len(rigs) + 1}"] = rig
    return rigs


def rigs_near(
    space: Space, start: Sequence[Mapping[str, Any]], number: int, seed: int
) -> dict[str, Rig]:
    """Draw `number` rigs by name, each near a rig of `start`: parameters of rigs, which take turns.

    They are off by up to a tenth of a zone and 5 degrees."""
    random = np.random.default_rng(seed)
    rigs: dict[str, Rig] = {}
    while len(rigs) < number:
        params = dict(start[len(rigs) % len(start)])
        for name, distribution in space.distributions(space.counts_per_zone(params)).items():
            if isinstance(distribution, FloatDistribution):
                reach = 5.0 if name.endswith("_deg") else 0.1
                params[name] = within(params[name] + random.uniform(-reach, reach), distribution)
        rig = space.rig(params)
        if is_possible(rig):
            rigs[f"generalist_{len(rigs) + 1}"] = rig
    return rigs


def _drawn(
    space: Mapping[str, BaseDistribution], count: int, random: np.random.Generator
) -> dict[str, Any]:
    """Draw parameters at random; some rigs are level, some have one height."""
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
