"""Rigs taken apart into the slots of a search."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass

from lidarplace import Mount
from lidarplace.base.number_text import point
from lidarplace.mounting.zone import TOLERANCE, Zone, distance
from sweeps.search.problem.choice import Choice, Choices, mirrored, ordered
from sweeps.search.problem.space import Slot, Space

_ANGLE = 1e-4
"""Radians by which an angle may be outside of its range."""


@dataclass(frozen=True)
class Placed:
    """A LiDAR, or the left one of a mirrored pair, in a slot, which has a trial's parameters."""

    slot: Slot
    lidar: Choice

    @property
    def rig(self) -> Choices:
        """It, or the pair."""
        if not self.slot.pair:
            return ordered([self.lidar])
        other = Choice(self.lidar.model, self.lidar.zone, mirrored(self.lidar.mount))
        return ordered([self.lidar, other])

    def allows(self, mount: Mount) -> bool:
        """Whether the LiDAR might sit there, in its zone, as far as its own slot goes."""
        zone = next(zone for zone in self.slot.zones if zone.name == self.lidar.zone)
        return _fits(self.slot, zone, mount)


def placed_in(space: Space, lidars: Sequence[Choice]) -> list[Placed]:
    """Give each of the LiDARs, without the fixed ones, to a slot of its kind.

    LiDARs without a zone get the first one that holds them, and those without a model its first.

    Raises:
        ValueError: their number is none of the space's, or one has no slot.
    """
    least, most = space.numbers
    if not least <= len(lidars) <= most:
        raise ValueError(f"has {len(lidars)} LiDARs, more or fewer than search.lidars")
    left: list[Choice] = list(lidars)
    for makeup in space.makeups:
        slots = space.slots(makeup)
        if sum(slot.size for slot in slots) != len(lidars):
            continue
        found, left = _in_slots(slots, lidars)
        if not left:
            return found
    mount = left[0].mount
    raise ValueError(
        f"no zone, or no mirrored pair of the search, has a LiDAR at "
        f"{point(mount.x, mount.y, mount.z)} with its angles"
    )


def _in_slots(slots: Sequence[Slot], lidars: Sequence[Choice]) -> tuple[list[Placed], list[Choice]]:
    """Each of the LiDARs in a slot, and those that are left when one slot gets none."""
    left, found = list(lidars), []
    for slot in slots:
        place = next((p for lidar in left if (p := _in_slot(slot, lidar, left))), None)
        if place is None:
            break
        found.append(place)
        for mount in (own.mount for own in place.rig):
            left.remove(next(lidar for lidar in left if _same(lidar.mount, mount)))
    return found, left


def rig_of(placed: Sequence[Placed], space: Space) -> Choices:
    """The rig of these LiDARs and those that every rig has."""
    return ordered([*space.fixed, *(lidar for place in placed for lidar in place.rig)])


def params_of(placed: Sequence[Placed], space: Space) -> dict[str, object]:
    """The parameters of a trial that asks about this rig."""
    return space.params([(place.slot, place.lidar) for place in placed])


def _in_slot(slot: Slot, lidar: Choice, left: Sequence[Choice]) -> Placed | None:
    """The LiDAR in that slot; a pair needs its mirrored one among those `left`."""
    mount, model = lidar.mount, lidar.model or slot.models[0]
    if model not in slot.models:
        return None
    if slot.pair:
        other = mirrored(mount)
        if mount.y <= 0 or not any(_same(own.mount, other) for own in left):
            return None
    for zone in slot.zones:
        if lidar.zone in ("", zone.name) and _fits(slot, zone, mount):
            return Placed(slot, Choice(model, zone.name, mount))
    return None


def _fits(slot: Slot, zone: Zone, mount: Mount) -> bool:
    turn = (mount.roll, mount.pitch, mount.yaw)
    return distance(zone, mount.x, mount.y, mount.z) <= TOLERANCE and all(
        abs(math.remainder(angle - math.radians(low + high) / 2, math.tau))
        <= math.radians(high - low) / 2 + _ANGLE
        for angle, (low, high) in zip(turn, slot.spans.values(), strict=True)
    )


def _same(one: Mount, other: Mount) -> bool:
    pairs = zip(astuple(one), astuple(other), strict=True)
    return all(abs(a - b) < _ANGLE for a, b in pairs)
