"""Placements: mounts of LiDARs, rigs, and the paper's eight."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from itertools import combinations, groupby

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import point, span
from lidarplace.base.plotting import Plottable
from lidarplace.base.ranges import ANGLE
from lidarplace.base.suggestions import did_you_mean
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.pose import angles, from_carla, rotation
from lidarplace.rigs.weather import Weather

_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class Mount:
    """Pose of one LiDAR in the ego frame: metres and radians, `R = Rz(yaw) Ry(pitch) Rx(roll)`.

    Raises ValueError: a number is not finite, or an angle is more than a turn, as if in degrees."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        values = (self.x, self.y, self.z, self.roll, self.pitch, self.yaw)
        if not all(map(math.isfinite, values)):
            raise InputError(key="mount", expected="finite coordinates and angles", found=values)
        for name in _POSE:
            value = float(getattr(self, name))
            if name not in "xyz":
                ANGLE.check(name, value, fix="use radians, or Mount.degrees")
            # NumPy's numbers would be written to files as `np.float64(1.5)`.
            object.__setattr__(self, name, value)

    @classmethod
    def degrees(
        cls,
        x: float = 0.0,
        y: float = 0.0,
        z: float = 0.0,
        roll: float = 0.0,
        pitch: float = 0.0,
        yaw: float = 0.0,
    ) -> Mount:
        """Return a mount whose angles are given in degrees."""
        return cls(x, y, z, math.radians(roll), math.radians(pitch), math.radians(yaw))

    def __repr__(self) -> str:
        angles = {"roll": self.roll, "pitch": self.pitch, "yaw": self.yaw}
        turned = [f"{n}={math.degrees(angle):.6g}" for n, angle in angles.items() if angle]
        at = [f"{name}={getattr(self, name):.6g}" for name in "xyz"]
        return f"Mount.degrees({', '.join([*at, *turned])})"

    @property
    def position(self) -> NDArray[np.float64]:
        """Position in the ego frame, shape (3,), metres."""
        return np.array([self.x, self.y, self.z])

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Sensor-to-ego rotation, shape (3, 3)."""
        return rotation(self.roll, self.pitch, self.yaw)


@dataclass(frozen=True)
class Placement(Plottable):
    """A named rig: LiDARs on one or more mounts.

    Attributes:
        lidar: the model of every mount, or a sequence with one for each.
        dead: further mounts and their models, of LiDARs that see nothing; they hide what is behind
            them, where their size is known.

    Raises:
        ValueError: there is no mount, two LiDARs sit in one place, or there are not as many models
            as mounts."""

    name: str
    mounts: Sequence[Mount]
    lidar: Lidar | Sequence[Lidar]
    dead: Sequence[tuple[Mount, Lidar]] = ()

    def __post_init__(self) -> None:
        where = f"placement {self.name!r}"
        mounts = (None,) if isinstance(self.mounts, Mount) else tuple(self.mounts)
        if not all(isinstance(mount, Mount) for mount in mounts):
            text = repr(self.mounts)
            raise InputError(place=where, key="mounts", expected="a list of Mount(…)", found=text)
        object.__setattr__(self, "mounts", mounts)
        if not self.mounts:
            raise InputError("no LiDAR", place=where)
        if not isinstance(self.lidar, Lidar):
            models = tuple(self.lidar)
            if not all(isinstance(model, Lidar) for model in models):
                allowed, text = "a Lidar, or a list of them", repr(self.lidar)
                raise InputError(place=where, key="lidar", expected=allowed, found=text)
            if len(models) != len(self.mounts):
                allowed = f"one model, or one for each of {len(self.mounts)} mounts"
                raise InputError(place=where, key="lidar", expected=allowed, found=len(models))
            # Rigs that are alike shall be equal.
            object.__setattr__(self, "lidar", models[0] if len(set(models)) == 1 else models)
        object.__setattr__(self, "dead", tuple(self.dead))
        for (i, a), (j, b) in combinations(enumerate(self.mounts, start=1), 2):
            if (a.x, a.y, a.z) == (b.x, b.y, b.z):
                wrong = f"LiDARs {i} and {j} are both at {point(a.x, a.y, a.z)}"
                raise InputError(wrong, place=where, expected="a place for each")

    def __repr__(self) -> str:
        at = ", ".join(f"{axis} {span([getattr(m, axis) for m in self.mounts])}" for axis in "xyz")
        beams = span([lidar.beams for lidar in self.lidars])
        number = f"{len(self.mounts)} LiDAR{'s' if len(self.mounts) > 1 else ''}"
        return f"Placement({self.name!r}: {number} of {beams} beams; {at} m)"

    def _repr_html_(self) -> str:
        table = pd.DataFrame([astuple(mount) for mount in self.mounts], columns=_POSE)
        table[list(_POSE[3:])] = np.degrees(table[list(_POSE[3:])]) + 0.0
        table["beams"] = [lidar.beams for lidar in self.lidars]
        head = f"<p>{html.escape(self.name)}: metres and degrees</p>"
        return head + table.to_html(float_format="{:.3g}".format)

    @property
    def lidars(self) -> tuple[Lidar, ...]:
        """Model of every mount."""
        if isinstance(self.lidar, Lidar):
            return (self.lidar,) * len(self.mounts)
        return tuple(self.lidar)

    def with_lidar(self, lidar: Lidar | Sequence[Lidar]) -> Placement:
        """Return the placement with another LiDAR model, or with one for each mount."""
        same = lidar == self.lidar if isinstance(lidar, Lidar) else tuple(lidar) == self.lidars
        return self if same else replace(self, lidar=lidar)

    def each_lidar(self, change: Callable[[Lidar], Lidar]) -> Placement:
        """Return the placement with a change of every LiDAR model, made once a model."""
        changed = {lidar: change(lidar) for lidar in dict.fromkeys(self.lidars)}
        return self.with_lidar([changed[lidar] for lidar in self.lidars])

    @property
    def takes_time(self) -> bool:
        """Whether a LiDAR takes time for a frame."""
        return any(lidar.timing is not None for lidar in self.lidars)

    def at_once(self) -> Placement:
        """Return the placement with LiDARs that fire all rays at the moment of the frame."""
        return self.each_lidar(Lidar.at_once) if self.takes_time else self

    def in_weather(self, weather: Weather) -> Placement:
        """Return the placement in that weather."""
        return self.each_lidar(lambda lidar: lidar.in_weather(weather))


def blocks(mount: Mount, lidar: Lidar) -> list[tuple[Mount, Lidar, slice]]:
    """Return a LiDAR as LiDARs without offsets: runs of beams with the same ones, on own mounts.

    Mount, model and, in the order of `Lidar.directions()`, the numbers of the rays of each: at the
    place where they start, and turned about the sensor's z axis; the LiDAR itself where it has no
    offsets."""
    if lidar.offsets is None and lidar.azimuth_offsets is None:
        return [(mount, lidar, slice(0, lidar.rays))]
    none = (0.0,) * lidar.beams
    both = list(zip(lidar.offsets or none, lidar.azimuth_offsets or none, strict=True))
    up, first, parts = mount.rotation[:, 2], 0, []
    for (offset, turn), beams in groupby(range(lidar.beams), both.__getitem__):
        elevations = tuple(lidar.elevations[b] for b in beams)
        block = replace(lidar, elevations=elevations, offsets=None, azimuth_offsets=None)
        x, y, z = (mount.position + offset * up).tolist()
        block_mount = replace(mount, x=x, y=y, z=z)
        if turn:
            turned = mount.rotation @ rotation(0.0, 0.0, turn)
            block_mount = Mount(x, y, z, *angles(turned))
            if (correction := lidar.correction) is not None and correction.mask is not None:
                mask = replace(correction.mask, turn=correction.mask.turn + turn)
                block = replace(block, correction=replace(correction, mask=mask))
        parts.append((block_mount, block, slice(first, first + block.rays)))
        first += block.rays
    return parts


# The paper's table of coordinates, in CARLA's convention: (x, y, z, roll, pitch).
_PAPER_TABLE: dict[str, tuple[tuple[float, ...], ...]] = {
    "line": ((0.0, -0.6, 2.2), (0.0, -0.4, 2.2), (0.0, 0.4, 2.2), (0.0, 0.6, 2.2)),
    "center": ((0.0, 0.0, 2.4), (0.0, 0.0, 2.6), (0.0, 0.0, 2.8), (0.0, 0.0, 3.0)),
    "trapezoid": ((-0.4, 0.2, 2.2), (-0.4, -0.2, 2.2), (0.2, 0.5, 2.2), (0.2, -0.5, 2.2)),
    "square": ((-0.5, 0.5, 2.2), (-0.5, -0.5, 2.2), (0.5, 0.5, 2.2), (0.5, -0.5, 2.2)),
    "line_roll": (
        (0.0, -0.6, 2.2, -0.28), (0.0, -0.4, 2.2), (0.0, 0.4, 2.2), (0.0, 0.6, 2.2, 0.28)
    ),
    "pyramid": ((-0.2, -0.6, 2.2), (0.4, 0.0, 2.4), (-0.2, 0.0, 2.6), (-0.2, 0.6, 2.2)),
    "pyramid_roll": (
        (-0.2, -0.6, 2.2, -0.28), (0.4, 0.0, 2.4), (-0.2, 0.0, 2.6), (-0.2, 0.6, 2.2, 0.28)
    ),
    "pyramid_pitch": (
        (-0.2, -0.6, 2.2), (0.4, 0.0, 2.4, 0.0, -0.09), (-0.2, 0.0, 2.6), (-0.2, 0.6, 2.2)
    ),
}  # fmt: skip


class _ByName(dict[str, Placement]):
    """Placements by name; an unknown name is answered with a similar one."""

    def __missing__(self, name: object) -> Placement:
        hint = did_you_mean(name, self) if isinstance(name, str) else ""
        raise KeyError(f"no placement {name!r}{hint}; there are {', '.join(self)}")


PAPER_PLACEMENTS: dict[str, Placement] = _ByName(
    (name, Placement(name, [Mount(*from_carla(*row)) for row in rows], Lidar.paper()))
    for name, rows in _PAPER_TABLE.items()
)
"""Placements of the paper, eight, in our right-handed ego frame, with its LiDAR."""
