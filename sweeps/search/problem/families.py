"""Rigs of few numbers, with which a search begins: where good rigs have been found so far.

A family lays LiDARs out in a zone (around its middle, across, along, in a stack, one above the
others) and has six numbers: how far they are apart, their height, a step of their pitches that lays
rings between each other, a roll outwards, a pitch of all.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, TypeVar

import numpy as np
from scipy.stats import qmc

from lidarplace import Lidar
from lidarplace.mounting.ring_overlap import beam_gap
from sweeps.search.problem.space import Slot, Space

_Item = TypeVar("_Item")
Shares = list[tuple[float, float, float]]
"""Of each LiDAR along x, y and z of its zone, 0 to 1."""
_STEPS = (0.0, 0.5, 1.0, 2.0, 4.0)
"""Of pitches, in the distance of two beams over the number of LiDARs: 1 is even interleaving."""
_ROLLS_DEG = (0.0, 0.0, 0.0, 5.0, 10.0, 15.0, 20.0, -10.0)
"""Outwards: a LiDAR on the left has its left side up."""
_PITCHES_DEG = (0.0, 0.0, 0.0, 3.0, 6.0, -3.0)
"""Of all LiDARs, nose down."""


def _around(number: int, spread: float, height: float) -> Shares:
    """On the corners of a rectangle, or evenly along an ellipse."""
    angles = np.pi / 4 + 2 * np.pi * np.arange(number) / number
    reach = 0.5 * spread * (np.sqrt(2) if number == 4 else 1)
    return [(0.5 + reach * np.cos(a), 0.5 + reach * np.sin(a), height) for a in angles]


def _across(number: int, spread: float, height: float) -> Shares:
    return [(0.5, y, height) for y in _even(number, spread)]


def _along(number: int, spread: float, height: float) -> Shares:
    return [(x, 0.5, height) for x in _even(number, spread)]


def _stack(number: int, spread: float, height: float) -> Shares:
    """Over the middle; the topmost is `height`, the lowest `spread` of it below."""
    return [(0.5, 0.5, z) for z in np.linspace(height, height * (1 - spread), number)]


def _one_above(number: int, spread: float, height: float) -> Shares:
    """One over the middle, the others around it below."""
    return [(0.5, 0.5, height), *_around(number - 1, spread, height / 2)][:number]


_LAYOUTS = [_around, _around, _across, _stack, _one_above, _along]
"""Each with its share of the trials."""


def family_params(
    space: Space, models: Mapping[str, Lidar], number: int, seed: int
) -> list[dict[str, Any]]:
    """Parameters of so many trials, even over the families' numbers (Sobol's sequence, scrambled);
    rings lie between each other by the distance of the beams of `models`."""
    if not number:
        return []
    points = qmc.Sobol(7, seed=seed).random_base2(int(np.ceil(np.log2(number))))[:number]
    makeups = [makeup for makeup in space.makeups if any(makeup)]
    found = []
    for place, point in enumerate(points):
        makeup = makeups[place % len(makeups)]
        counts = dict(zip(space.counts, makeup, strict=True))
        params = {name: n for name, n in counts.items() if len(set(space.counts[name])) > 1}
        for _, own in groupby(space.slots(makeup), key=lambda slot: (slot.zones, slot.pair)):
            params |= _laid_out(space, list(own), models, point)
        found.append(params)
    return found


def _laid_out(
    space: Space, slots: Sequence[Slot], models: Mapping[str, Lidar], point: np.ndarray
) -> dict[str, Any]:
    """Parameters of the slots of one zone; of mirrored pairs those of the left LiDARs."""
    layout, apart, height, step, roll, pitch, kind = point.tolist()
    zones, names = slots[0].zones, slots[0].models
    zone, model = _one_of(zones, kind), _one_of(names, kind)
    spread = 0.4 + 0.6 * apart  # nearer LiDARs are like one
    shares = _one_of(_LAYOUTS, layout)(len(slots), spread, height)
    gap = math.degrees(beam_gap([models[model]])) / sum(slot.size for slot in slots)
    steps = _one_of(_STEPS, step) * gap * (np.arange(len(slots)) - (len(slots) - 1) / 2)
    outwards, nose = _one_of(_ROLLS_DEG, roll), _one_of(_PITCHES_DEG, pitch)
    params: dict[str, Any] = {}
    for slot, (x, y, z), own in zip(slots, shares, steps.tolist(), strict=True):
        side = 1.0 if slot.pair else float(np.sign(round(y - 0.5, 9)))
        low, high = slot.spans["yaw"]
        wanted = {"x": x, "y": y, "z": z, "roll_deg": side * outwards, "pitch_deg": nose + own}
        wanted |= {"yaw_deg": (low + high) / 2, "zone": zone.name, "model": model}
        params |= space.allowed(slot, wanted)
    return params


def _even(number: int, spread: float) -> list[float]:
    """Shares around the middle."""
    if number == 1:
        return [0.5]
    found: list[float] = np.linspace(0.5 - spread / 2, 0.5 + spread / 2, number).tolist()
    return found


def _one_of(items: Sequence[_Item], share: float) -> _Item:
    return items[min(int(share * len(items)), len(items) - 1)]
