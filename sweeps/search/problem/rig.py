"""Rigs of a search: a model and a mount for each LiDAR; a placement, if they are possible."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, replace

from lidarplace import Lidar, Mount, Placement


@dataclass(frozen=True, order=True)
class MountedLidar:
    """A LiDAR of a rig.

    `model` and `zone` are names; the zone of a fixed LiDAR is empty. A dead LiDAR only hides what
    is behind it."""

    model: str
    zone: str
    mount: Mount
    dead: bool = False


Rig = tuple[MountedLidar, ...]
"""LiDARs in the order of `ordered`, with names of models and zones, which a `Placement` lacks."""


def ordered(choices: Iterable[MountedLidar]) -> Rig:
    """Return LiDARs in a canonical order: the same LiDARs are equal, whatever their order was."""
    return tuple(sorted(choices, key=lambda c: (c.model, c.zone, astuple(c.mount))))


def is_possible(choices: Rig) -> bool:
    """Return whether there is a LiDAR, and no two have the same position."""
    return 0 < len({(c.mount.x, c.mount.y, c.mount.z) for c in choices}) == len(choices)


def placement_of(choices: Rig, models: Mapping[str, Lidar], name: str = "rig") -> Placement:
    """Return the placement of a rig. Raises ValueError if two LiDARs have the same position."""
    working = [c for c in choices if not c.dead]
    return Placement(
        name,
        [c.mount for c in working],
        lidar=[models[c.model] for c in working],
        dead=[(c.mount, models[c.model]) for c in choices if c.dead],
    )


def rounded(x: float, y: float, z: float, *angles: float) -> Mount:
    """Return a mount to the millimetre and a ten-thousandth of a radian; angles may pass a turn.

    No one mounts more exactly, and the files that people read have short numbers."""
    # + 0.0: no negative zero.
    lengths = [round(value, 3) + 0.0 for value in (x, y, z)]
    return Mount(*lengths, *(round(math.fmod(angle, math.tau), 4) + 0.0 for angle in angles))


def mirrored(mount: Mount) -> Mount:
    """Return a mount on the other side of the vehicle: left and right exchanged."""
    # 0 - v, not -v: a zero stays +0, so that equal rigs are equal.
    return replace(mount, y=0 - mount.y, roll=0 - mount.roll, yaw=0 - mount.yaw)
