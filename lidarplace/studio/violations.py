"""Which constraints a rig does not keep, where and by how much."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.vehicle import depth_in
from lidarplace.mounting.zone import distance
from lidarplace.studio.rig import Rig
from lidarplace.studio.rigs_file import RigsFile

ROUNDING = 1e-9
"""0.6 - 0.4 is not quite 0.2."""
MICROMETRE = 1e-6
"""What is on the edge of a zone is in it."""


@dataclass(frozen=True)
class Violation:
    """A constraint that is not kept.

    Attributes:
        constraint: zone, body, keep_out, distance, body_share or price.
        lidars: numbers of those concerned; none if it is the rig.
        excess: by how much: metres, a share, or money; NaN where it is not known.
        text: the same for people.
    """

    constraint: str
    lidars: tuple[int, ...]
    excess: float
    text: str


def price_of(rig: Rig, file: RigsFile) -> float:
    """Of all LiDARs, disabled or not; NaN if one of them has no price."""
    default = file.settings.lidar.name
    names = (lidar.model if "lidar" in lidar.written else default for lidar in rig.lidars)
    return math.fsum(file.settings.prices.get(name or "", math.nan) for name in names)


def violations(rig: Rig, file: RigsFile) -> tuple[Violation, ...]:
    """All that the rig does not keep of what the file says."""
    found = [*_outside(rig, file), *_inside(rig, file), *_close(rig, file), *_blocked(rig, file)]
    limit, price = file.settings.constraints.price, price_of(rig, file)
    if limit is not None and not price <= limit + ROUNDING:
        text = f"price {price:g}: {price - limit:g} above {limit:g}"
        if math.isnan(price):
            text = f"price: of {', '.join(_without_price(rig, file))} it is not known"
        found.append(Violation("price", (), price - limit, text))
    return tuple(found)


def _without_price(rig: Rig, file: RigsFile) -> list[str]:
    default = file.settings.lidar.name
    names = Counter(
        (lidar.model if "lidar" in lidar.written else default) or "a LiDAR without a name"
        for lidar in rig.lidars
    )
    return [name for name in names if name not in file.settings.prices]


def _outside(rig: Rig, file: RigsFile) -> list[Violation]:
    found = []
    for number, mount in enumerate(rig.mounts) if file.zones else ():
        away, name = min((distance(z, mount.x, mount.y, mount.z), z.name) for z in file.zones)
        if away > MICROMETRE:
            text = f"LiDAR {number}: {away:.3g} m outside of the nearest zone, {name}"
            found.append(Violation("zone", (number,), away, text))
    return found


def _inside(rig: Rig, file: RigsFile) -> list[Violation]:
    found = []
    places = np.array([mount.position for mount in rig.mounts]).reshape(-1, 3)
    for constraint, boxes, what in (
        ("body", file.vehicle.interior, "the vehicle's body"),
        ("keep_out", file.keep_out, "what is kept out"),
    ):
        for number, depth in enumerate(depth_in(boxes, places).tolist()):
            if depth > 0:
                text = f"LiDAR {number}: {depth:.3g} m inside of {what}"
                found.append(Violation(constraint, (number,), depth, text))
    return found


def _close(rig: Rig, file: RigsFile) -> list[Violation]:
    least, found = file.settings.constraints.distance, []
    for i, j in combinations(range(len(rig.mounts)), 2):
        apart = math.dist(rig.mounts[i].position, rig.mounts[j].position)
        if apart < least - ROUNDING or apart == 0:
            text = f"LiDARs {i} and {j}: {apart:.3g} m apart, {least - apart:.3g} m too close"
            if apart == 0:
                text = f"LiDARs {i} and {j}: in one place"
            found.append(Violation("distance", (i, j), least - apart, text))
    return found


def _blocked(rig: Rig, file: RigsFile) -> list[Violation]:
    limit, found = file.settings.constraints.body_share, []
    if limit is None:
        return []
    models = rig.models(file.settings.lidar.lidar())
    for number, (mount, lidar) in enumerate(zip(rig.mounts, models, strict=True)):
        share = body_share(mount, lidar, file.body)
        if share > limit + ROUNDING:
            text = (
                f"LiDAR {number}: {100 * share:.3g} % of its rays meet the vehicle, "
                f"allowed are {100 * limit:g} %"
            )
            found.append(Violation("body_share", (number,), share - limit, text))
    return found
