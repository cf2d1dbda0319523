"""What a search chooses: a model and a mount for each LiDAR; a placement, if they are possible."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, replace

from lidarplace import Lidar, Mount, Placement


@dataclass(frozen=True, order=True)
class Choice:
    """One LiDAR: its model and the zone in which it sits, which is empty if it is fixed, by name;
    its pose; and whether it is dead and only hides what is behind it."""

    model: str
    zone: str
    mount: Mount
    dead: bool = False


Choices = tuple[Choice, ...]
"""In the order of `ordered`: a rig by names of models and zones, which a `Placement` has not."""


def ordered(choices: Iterable[Choice]) -> Choices:
    """In a canonical order: the same LiDARs are equal, in whatever order they come."""
    return tuple(sorted(choices, key=lambda c: (c.model, c.zone, astuple(c.mount))))


def is_possible(choices: Choices) -> bool:
    """Whether there is a LiDAR, and no two sit in one place."""
    return 0 < len({(c.mount.x, c.mount.y, c.mount.z) for c in choices}) == len(choices)


def placement_of(choices: Choices, models: Mapping[str, Lidar], name: str = "rig") -> Placement:
    """The placement. Raises ValueError if two LiDARs sit in one place."""
    working = [c for c in choices if not c.dead]
    return Placement(
        name,
        [c.mount for c in working],
        lidar=[models[c.model] for c in working],
        dead=[(c.mount, models[c.model]) for c in choices if c.dead],
    )


def rounded(x: float, y: float, z: float, *angles: float) -> Mount:
    """To the millimetre and a ten-thousandth of a radian: no one mounts more exactly, and the files
    that people read have short numbers. Angles may pass a turn."""
    # + 0.0: no negative zero.
    lengths = [round(value, 3) + 0.0 for value in (x, y, z)]
    return Mount(*lengths, *(round(math.fmod(angle, math.tau), 4) + 0.0 for angle in angles))


def mirrored(mount: Mount) -> Mount:
    """On the other side of the vehicle: left and right exchanged."""
    # 0 - v, not -v: a zero stays +0, so that equal rigs are equal.
    return replace(mount, y=0 - mount.y, roll=0 - mount.roll, yaw=0 - mount.yaw)
