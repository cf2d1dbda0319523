"""Rays of a LiDAR whose pattern does not repeat, as a table in the order of firing."""

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError

ENDS = {"azimuths": 2 * math.pi + 1e-9, "elevations": math.pi / 2}
"""Greatest angles, either way, radians."""


@dataclass(frozen=True, eq=False)
class ScanPattern:
    """Rays that are fired one after the other; each frame shows the next part of the table.

    After the last whole frame it begins anew. Patterns of equal content are equal. Angles are in
    the sensor's frame, as those of a `Lidar`, radians, read-only.

    Raises ValueError: shapes differ, an angle is out of bounds, or there is not one frame of rays.
    """

    azimuths: NDArray[np.float64]  # of every ray of all frames, shape (rays,)
    elevations: NDArray[np.float64]
    rays_per_frame: int

    def __post_init__(self) -> None:
        for name, most in ENDS.items():
            angles = np.array(getattr(self, name), np.float64)
            if angles.ndim != 1 or not (np.abs(angles) <= most).all():
                raise InputError(key=name, expected=f"radians within ±{most:.4g}, in a row")
            angles.flags.writeable = False
            object.__setattr__(self, name, angles)
        if len(self.azimuths) != len(self.elevations):
            raise ValueError(
                f"{len(self.azimuths)} azimuths for {len(self.elevations)} elevations of rays"
            )
        if not 1 <= self.rays_per_frame <= len(self.azimuths):
            allowed = f"1 to the {len(self.azimuths):,} rays of the pattern"
            raise InputError(key="rays_per_frame", expected=allowed, found=self.rays_per_frame)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ScanPattern) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        return f"ScanPattern({self.frames} frames of {self.rays_per_frame:,} rays)"

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the content."""
        digest = hashlib.sha256(str(self.rays_per_frame).encode())
        for angles in (self.azimuths, self.elevations):
            digest.update(angles.tobytes())
        return digest.hexdigest()

    @property
    def frames(self) -> int:
        """Number of whole frames in the table."""
        return len(self.azimuths) // self.rays_per_frame

    def of_frame(self, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return azimuths, ascending in [-pi, pi), and elevations of the rays of any frame."""
        rows, azimuths, order = self._sorted(number)
        return azimuths[order], self.elevations[rows][order]

    def order_in_frame(self, number: int) -> NDArray[np.float64]:
        """Return when the rays of `of_frame` are fired, as shares of the frame, in (0, 1)."""
        return (self._sorted(number)[2] + 0.5) / self.rays_per_frame

    def _sorted(self, number: int) -> tuple[slice, NDArray[np.float64], NDArray[np.int64]]:
        """Return the rows of a frame, their azimuths in [-pi, pi), and their order by azimuth."""
        first = number % self.frames * self.rays_per_frame
        rows = slice(first, first + self.rays_per_frame)
        azimuths = (self.azimuths[rows] + math.pi) % (2 * math.pi) - math.pi
        return rows, azimuths, np.argsort(azimuths, kind="stable")

    def thinned(self, share: float) -> "ScanPattern":
        """Return the pattern with a share, in (0, 1], of the rays of every frame.

        Rounded, at least one, evenly spread in time."""
        few = max(1, round(share * self.rays_per_frame))
        fired = (2 * np.arange(few) + 1) * self.rays_per_frame // (2 * few)
        rows = (np.arange(self.frames)[:, None] * self.rays_per_frame + fired).reshape(-1)
        return ScanPattern(self.azimuths[rows], self.elevations[rows], few)

    @cached_property
    def field_of_view(self) -> tuple[float, float]:
        """The narrowest interval of azimuths that holds all rays, radians, [min, max).

        A turn if its gap is below 5 degrees."""
        turned = np.unique(self.azimuths % (2 * math.pi))
        gaps = np.diff(turned, append=turned[0] + 2 * math.pi)
        widest = int(gaps.argmax())
        if gaps[widest] < math.radians(5.0):
            return -math.pi, math.pi
        low = float(turned[(widest + 1) % len(turned)])
        low -= 2 * math.pi * (low >= math.pi)
        return low, low + max(2 * math.pi - float(gaps[widest]), 1e-9)

    @classmethod
    def of_prisms(
        cls, turns: tuple[float, float], field_of_view: float, rays_per_frame: int, frames: int
    ) -> "ScanPattern":
        """Return the rosette of two turning prisms about the sensor's x axis.

        Each prism bends the ray by a quarter of the field of view towards where its thick side is,
        and bends add up: the paraxial model of Risley prisms (Marshall 1999, Risley prism scan
        patterns, Proc. SPIE 3787, 74). `turns` are of either prism in a frame, signed, the field of
        view is a cone, radians; rays are evenly spread in time."""
        time = np.arange(frames * rays_per_frame) / rays_per_frame
        bent = sum(np.exp(2j * math.pi * (turn * time % 1.0)) for turn in turns)
        bent = 0.25 * field_of_view * np.asarray(bent)
        away, clock = np.abs(bent), np.angle(bent)
        side, up = np.sin(away) * np.cos(clock), np.sin(away) * np.sin(clock)
        return cls(np.arctan2(side, np.cos(away)), np.arcsin(up), rays_per_frame)
