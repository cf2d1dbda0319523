"""Families of rigs with few parameters, with which a search begins: where good rigs were so far.

A family lays LiDARs out in a zone (around its middle, across, along, in a stack, one above the
others) and has six numbers: how far they are apart, their height, a step of their pitches that lays
rings between each other, a roll outwards, a pitch of all."""

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, TypeVar

import numpy as np
from scipy.stats import qmc

from lidarplace import Lidar
from lidarplace.mounting.ring_overlap import beam_gap
from sweeps.search.problem.slots import MountSlot
from sweeps.search.problem.space import Space

_Item = TypeVar("_Item")
Shares = list[tuple[float, float, float]]
"""Position of each LiDAR along x, y and z of its zone, 0 to 1."""
_STEPS = (0.0, 0.5, 1.0, 2.0, 4.0)
"""Steps of pitch, in the distance of two beams over the number of LiDARs: 1 interleaves evenly."""
_ROLLS_DEG = (0.0, 0.0, 0.0, 5.0, 10.0, 15.0, 20.0, -10.0)
"""Rolls outwards: a LiDAR on the left has its left side up."""
_PITCHES_DEG = (0.0, 0.0, 0.0, 3.0, 6.0, -3.0)
"""Pitches of all LiDARs, nose down."""


def _around(number: int, spread: float, height: float) -> Shares:
    """Place LiDARs on the corners of a rectangle, or evenly along an ellipse."""
    angles = np.pi / 4 + 2 * np.pi * np.arange(number) / number
    reach = 0.5 * spread * (np.sqrt(2) if number == 4 else 1)
    return [(0.5 + reach * np.cos(a), 0.5 + reach * np.sin(a), height) for a in angles]


def _across(number: int, spread: float, height: float) -> Shares:
    return [(0.5, y, height) for y in _even(number, spread)]


def _along(number: int, spread: float, height: float) -> Shares:
    return [(x, 0.5, height) for x in _even(number, spread)]


def _stack(number: int, spread: float, height: float) -> Shares:
    """Place LiDARs over the middle; the topmost is `height`, the lowest `spread` of it below."""
    return [(0.5, 0.5, z) for z in np.linspace(height, height * (1 - spread), number)]


def _one_above(number: int, spread: float, height: float) -> Shares:
    """Place one LiDAR over the middle, the others around it below."""
    return [(0.5, 0.5, height), *_around(number - 1, spread, height / 2)][:number]


_LAYOUTS = [_around, _around, _across, _stack, _one_above, _along]
"""Layouts, each with its share of the trials."""


def family_params(
    space: Space, models: Mapping[str, Lidar], number: int, seed: int
) -> list[dict[str, Any]]:
    """Return parameters of `number` trials, even over the families' numbers.

    They are a Sobol sequence, scrambled. All LiDARs of a zone have one model, as far as bounds of
    models allow; other trials mix them. Rings lie between each other by the distance of the beams
    of `models`."""
    if not number:
        return []
    points = qmc.Sobol(7, seed=seed).random_base2(int(np.ceil(np.log2(number))))[:number]
    all_counts = [counts for counts in space.all_counts if any(counts)]
    parameters = []
    for place, point in enumerate(points):
        counts_per_zone = all_counts[place % len(all_counts)]
        counts = dict(zip(space.count_ranges, counts_per_zone, strict=True))
        params = {name: n for name, n in counts.items() if len(set(space.count_ranges[name])) > 1}
        slots = space.slots(counts_per_zone)
        for _, zone_slots in groupby(slots, key=lambda slot: (slot.zones, slot.pair)):
            params |= _laid_out(space, list(zone_slots), models, point)
        parameters.append(params)
    return parameters


def _laid_out(
    space: Space, slots: Sequence[MountSlot], models: Mapping[str, Lidar], point: np.ndarray
) -> dict[str, Any]:
    """Return parameters of the slots of one zone; of mirrored pairs those of the left LiDARs."""
    layout, apart, height, step, roll, pitch, kind = point.tolist()
    zones, names = slots[0].zones, slots[0].models
    zone, model = _one_of(zones, kind), _one_of(names, kind)
    spread = 0.4 + 0.6 * apart  # nearer LiDARs are like one
    shares = _one_of(_LAYOUTS, layout)(len(slots), spread, height)
    gap = math.degrees(beam_gap([models[model]])) / sum(slot.size for slot in slots)
    steps = _one_of(_STEPS, step) * gap * (np.arange(len(slots)) - (len(slots) - 1) / 2)
    outwards, nose = _one_of(_ROLLS_DEG, roll), _one_of(_PITCHES_DEG, pitch)
    params: dict[str, Any] = {}
    for slot, (x, y, z), pitch_offset in zip(slots, shares, steps.tolist(), strict=True):
        side = 1.0 if slot.pair else float(np.sign(round(y - 0.5, 9)))
        low, high = slot.spans[model]["yaw"]
        wanted: dict[str, Any] = {"x": x, "y": y, "z": z, "roll_deg": side * outwards}
        wanted["pitch_deg"] = nose + pitch_offset
        wanted |= {"yaw_deg": (low + high) / 2, "zone": zone.name, "model": model}
        params |= space.allowed(slot, wanted)
    return params


def _even(number: int, spread: float) -> list[float]:
    """Return evenly spaced shares around the middle."""
    ends = (0.5 - spread / 2, 0.5 + spread / 2)
    return [0.5] if number == 1 else list(map(float, np.linspace(*ends, number)))


def _one_of(items: Sequence[_Item], share: float) -> _Item:
    return items[min(int(share * len(items)), len(items) - 1)]
