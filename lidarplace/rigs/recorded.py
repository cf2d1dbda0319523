"""Rig of a recording: which LiDARs were on the vehicle, where, and of what model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.base.suggestions import did_you_mean
from lidarplace.rigs.placement import Placement

MOST_MM = 10.0
MOST_DEGREES = 0.5
"""Largest difference of mounts of one rig between scenes, as that of mounting errors."""


@dataclass(frozen=True)
class RecordedRig:
    """LiDARs by name, as they were when a log was recorded. JSON holds it as `asdict` does.

    Raises ValueError: there is not one name for each mount, two names are equal or one is empty, or
    a LiDAR fires a pattern of rays, which no file holds."""

    names: tuple[str, ...]  # in the order of the mounts, such as ("up_lidar", "down_lidar")
    placement: Placement

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        if len(self.names) != len(self.placement.mounts):
            wrong = f"{len(self.names)} names for {len(self.placement.mounts)} LiDARs"
            raise InputError(wrong, key="rig")
        if len(set(self.names)) < len(self.names) or not all(self.names):
            wrong = "duplicate or empty name of a LiDAR"
            raise InputError(wrong, key="rig", found=", ".join(self.names))
        for name, lidar in zip(self.names, self.placement.lidars, strict=True):
            if lidar.pattern is not None:
                wrong = f"LiDAR {name} has a scan pattern"
                fix = "beams that turn, because a log's rig.json holds no pattern"
                raise InputError(wrong, key="rig", expected=fix)

    def subset(self, names: Sequence[str]) -> "RecordedRig":
        """Return the rig with these LiDARs only, in its own order.

        Raises ValueError: a name is unknown, or there is none."""
        for name in names:
            if name not in self.names:
                hint = did_you_mean(name, self.names)
                wrong = f"unknown LiDAR {name!r}{hint} of the recorded rig"
                raise InputError(wrong, expected=", ".join(self.names))
        numbers = [n for n, name in enumerate(self.names) if name in names]
        lidar_names = tuple(self.names[n] for n in numbers)
        mounts, lidars = self.placement.mounts, self.placement.lidars
        name = "+".join(lidar_names) if len(lidar_names) < len(self.names) else self.placement.name
        rig = Placement(name, [mounts[n] for n in numbers], [lidars[n] for n in numbers])
        return RecordedRig(lidar_names, rig)


def one_rig(rigs: Mapping[str, RecordedRig]) -> RecordedRig:
    """Return the rig of all scenes, that of the first one.

    Raises ValueError: there is none, or scenes have other LiDARs, or mounts that differ by more
    than `MOST_MM` or `MOST_DEGREES`."""
    if not rigs:
        raise InputError("no recorded rig", fix="convert the log with its calibration")
    (first, rig), *others = rigs.items()
    for scene, other in others:
        where = f"scenes {first} and {scene}"
        if other.names != rig.names or other.placement.lidars != rig.placement.lidars:
            wrong = f"{where} have LiDARs of other names or models"
            raise InputError(wrong, fix="make a log of each")
        for name, a, b in zip(rig.names, rig.placement.mounts, other.placement.mounts, strict=True):
            cosine = np.clip((np.trace(a.rotation.T @ b.rotation) - 1) / 2, -1, 1)
            millimetres = 1000 * np.linalg.norm(a.position - b.position)
            degrees = np.degrees(np.arccos(cosine))
            if millimetres > MOST_MM or degrees > MOST_DEGREES:
                raise InputError(
                    f"{where} have LiDAR {name} in different places",
                    expected=f"at most {MOST_MM:g} mm and {MOST_DEGREES:g} degrees",
                    found=f"{millimetres:.0f} mm and {degrees:.1f} degrees",
                    fix="make a log of each",
                )
    return rig
