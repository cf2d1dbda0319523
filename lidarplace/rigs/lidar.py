"""A LiDAR model: its beams, its azimuth steps and what limits and disturbs its returns."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import InstanceOf
from pydantic.json_schema import SkipJsonSchema

from lidarplace.base.code_version import OMIT_DEFAULT
from lidarplace.base.errors import InputError
from lidarplace.base.ranges import AZIMUTH_STEPS
from lidarplace.rigs.catalogue.datasheet import FRAMES_PER_S, Datasheet, datasheet, metres
from lidarplace.rigs.correction import Correction
from lidarplace.rigs.scan_pattern import ScanPattern
from lidarplace.rigs.scan_timing import ScanTiming
from lidarplace.rigs.weather import Weather, shortened

# Ends of a field of view, and a whole turn, are meant up to the rounding of degrees to radians.
HAIR = 1e-12
FULL_TURN = 2 * math.pi + HAIR

MOST_OFFSET = 1.0  # of a laser within its housing, metres
PATTERN_FRAMES = 20  # of a rosette, until it begins anew


@lru_cache(maxsize=8)
def pattern_in(sheet: Datasheet) -> ScanPattern | None:
    """Return the pattern of a LiDAR of the catalogue; None for one whose beams turn."""
    if sheet.rosette is None:
        return None
    first, second = (rpm / 60.0 / FRAMES_PER_S for rpm in sheet.rosette.rpm)
    angle = math.radians(sheet.rosette.field_of_view_deg)
    return ScanPattern.of_prisms((first, second), angle, sheet.rays, PATTERN_FRAMES)


@dataclass(frozen=True)
class Lidar:
    """A LiDAR that fires every beam at every azimuth step within its field of view.

    Or it fires the rays of a pattern: beams that fire once in a frame, at an azimuth of their own.

    Attributes:
        elevations: elevation of every beam above the sensor's xy plane, radians, in [-pi/2, pi/2].
        azimuth_steps: firings of each beam in one full turn; those outside `azimuth` are left out.
        range: farthest return, metres, in clear air; see `reach`.
        range_noise: standard deviation of the measured range, metres.
        drop_off: probability that a return is lost, in [0, 1).
        azimuth: horizontal field of view, [min, max) in radians, at most one turn; 0 is the
            sensor's x axis, growing towards y. May cross pi: (2.0, 4.0) looks back. A part of a
            turn that is a whole number of steps wide has just as many, wherever it begins.
        min_range: nearest return, metres; what is nearer stops the ray and returns nothing.
        range_10, range_80: farthest return, metres, of a surface that reflects 10 % and 80 % of
            the light and faces the ray; None for the first: all surfaces return from up to `range`;
            for the second alone: light thins out by the square of the distance. See `sight`.
        wavelength: of its light, metres.
        extinction: rate at which the air takes light, 1/m; see `in_weather`.
        window: share of the light that passes its front window, on either way; 1: as new.
        size: length, width and height of the housing around the origin of the sensor's frame,
            metres, by which it hides what is behind it from other LiDARs; equal length and width
            are the diameter of a cylinder. None: not known, nothing is hidden.
        pattern: of rays, for a LiDAR without beams that turn; it decides `elevations` and
            `azimuth`, whatever is given for them, and there is one azimuth step. See `patterned`.
        frame: of the pattern that is fired.
        correction: what it loses on a real vehicle; None: nothing. See `corrected`.
        offsets: of every laser along the sensor's z axis, metres: there its rays start; None: all
            start at the origin. See `lidarplace.rigs.placement.blocks`.
        azimuth_offsets: of every beam, radians, > 0 to the left: a beam fires at the azimuth steps
            and in the field of view turned by that; None: at the steps. See `blocks`, too.
        timing: when its rays are fired, in clouds; None: all at the moment of the frame.

    Raises:
        ValueError: a value is out of its bounds, no azimuth step is in the field of view, light
            is lost by a LiDAR that sees surfaces of 10 % as far as those of 80 %, or a LiDAR with a
            pattern has azimuth steps."""

    elevations: tuple[float, ...]
    azimuth_steps: int
    range: float = 100.0
    range_noise: float = 0.0
    drop_off: float = 0.0
    azimuth: tuple[float, float] = (-math.pi, math.pi)
    min_range: float = 0.0
    range_10: float | None = None
    range_80: float | None = None
    wavelength: float = 905e-9
    extinction: float = 0.0
    window: float = 1.0
    size: tuple[float, float, float] | None = None
    pattern: SkipJsonSchema[InstanceOf[ScanPattern]] | None = None  # no file holds one
    frame: int = 0
    correction: Correction | None = None
    offsets: tuple[float, ...] | None = None
    azimuth_offsets: tuple[float, ...] | None = None
    timing: SkipJsonSchema[InstanceOf[ScanTiming]] | None = field(
        default=None, metadata={OMIT_DEFAULT: True}
    )

    def __post_init__(self) -> None:
        elevations: Iterable[float] = self.elevations
        if self.pattern is not None:
            if (steps := self.azimuth_steps) != 1:
                raise InputError(key="azimuth_steps", expected="1 for a pattern", found=steps)
            elevations = self.pattern.of_frame(self.frame)[1]
            object.__setattr__(self, "azimuth", self.pattern.field_of_view)
        object.__setattr__(self, "elevations", tuple(map(float, elevations)))
        if not self.elevations:
            raise ValueError("a LiDAR needs at least one beam")
        if self.pattern is None and not all(abs(e) <= math.pi / 2 for e in self.elevations):
            expected = "radians within [-pi/2, pi/2]"
            raise InputError(key="elevations", expected=expected, found=self.elevations)
        self._check_offsets()
        AZIMUTH_STEPS.check_whole("azimuth_steps", self.azimuth_steps)
        if self.range_10 is None and self.range_80 is not None:
            raise InputError("needs range_10", key="range_80")
        near = self.range_10 is None or 0 < self.range_10 <= (self.range_80 or math.inf)
        for key, expected, possible in (
            ("range", "more than 0 m", self.range > 0),
            ("range_noise", "at least 0 m", self.range_noise >= 0),
            ("drop_off", "a number within [0, 1)", 0 <= self.drop_off < 1),
            ("min_range", "a number within [0, range)", 0 <= self.min_range < self.range),
            ("range_10", "more than 0 m, at most range_80", near),
            ("wavelength", "more than 0 m", self.wavelength > 0),
            ("extinction", "a finite number >= 0", 0 <= self.extinction < math.inf),
            ("window", "a number within (0, 1]", 0 < self.window <= 1),
        ):
            if not possible:
                raise InputError(key=key, expected=expected, found=getattr(self, key))
        if self.falloff == 0 and (self.extinction > 0 or self.window < 1):
            wrong = "equals range_10, so the range at which light is lost is unknown"
            raise InputError(wrong, key="range_80", found=self.range_80)
        if self.size is not None:
            object.__setattr__(self, "size", tuple(map(float, self.size)))
            if len(self.size) != 3 or not all(0 < side < math.inf for side in self.size):
                expected = "length, width and height > 0"
                raise InputError(key="size", expected=expected, found=self.size)
        low, high = map(float, self.azimuth)
        object.__setattr__(self, "azimuth", (low, high))
        if not (math.isfinite(low) and math.isfinite(high) and 0 < high - low <= FULL_TURN):
            expected = "finite min < max, at most one turn of 2 pi radians"
            raise InputError(key="azimuth", expected=expected, found=(low, high))
        if self.fired_steps < 1:
            wrong = f"none of the {self.azimuth_steps} azimuth steps of a turn is within it"
            raise InputError(wrong, key="azimuth", found=f"[{low}, {high}) radians")

    def _check_offsets(self) -> None:
        for key, most, unit in (("offsets", MOST_OFFSET, "m"), ("azimuth_offsets", math.pi, "rad")):
            if (values := getattr(self, key)) is None:
                continue
            values = tuple(map(float, values))
            object.__setattr__(self, key, values)
            if self.pattern is not None or len(values) != self.beams:
                each = (
                    "none for a pattern" if self.pattern else f"one for each of {self.beams} beams"
                )
                raise InputError(key=key, expected=each, found=len(values))
            if not all(abs(value) <= most for value in values):
                ends = f"{min(values):g} to {max(values):g} {unit}"
                raise InputError(key=key, expected=f"at most ±{most:g} {unit}", found=ends)

    def __repr__(self) -> str:
        low, high = np.degrees([min(self.elevations), max(self.elevations)])
        left, right = np.degrees(self.azimuth)
        view = "" if self.full_turn else f", azimuth {left:.6g} to {right:.6g} degrees"
        beams, steps = f"{self.beams} beams", f", {self.azimuth_steps} azimuth steps a turn"
        if self.pattern is not None:
            beams, steps = f"pattern of {self.beams:,} rays a frame", ""
        lost = "" if self.correction is None else f", {self.correction!r}"
        return (
            f"Lidar({beams}, {low:.6g} to {high:.6g} degrees{steps}{view}, "
            f"range {self.range:.6g} m{lost})"
        )

    @classmethod
    def paper(cls) -> Lidar:
        """Return the paper's sensor: 16 beams, -25 to 5 degrees, 90,000 points a frame at 20 Hz."""
        return cls.even()

    @classmethod
    def even(
        cls,
        beams: int = 16,
        elevation_deg: tuple[float, float] = (-25.0, 5.0),
        azimuth_steps: int = 5625,
        azimuth_deg: tuple[float, float] = (-180.0, 180.0),
        **limits: Any,
    ) -> Lidar:
        """Return a LiDAR of beams evenly spread from the lowest to the highest elevation, degrees.

        `limits` are other attributes, such as `range`."""
        if beams < 1:
            raise InputError(key="beams", expected="at least 1", found=beams)
        low, high = azimuth_deg
        return cls(
            tuple(np.radians(np.linspace(*elevation_deg, beams))),
            azimuth_steps,
            azimuth=(math.radians(low), math.radians(high)),
            **limits,
        )

    @classmethod
    def named(cls, name: str) -> Lidar:
        """Return a LiDAR of the catalogue, "vlp16" or "VLP-16": `lidarplace sensors` lists them.

        It turns 10 times a second, "hdl32e@20hz" 20 times, with half of the azimuth steps. Its
        range noise is 0 where no source gives a standard deviation. Raises ValueError if there is
        none of that name."""
        sheet = datasheet(name)
        low, high = map(math.radians, sheet.azimuth_deg)
        return cls(
            tuple(map(math.radians, sheet.elevations_deg)),
            sheet.azimuth_steps,
            sheet.range,
            sheet.range_noise or 0.0,
            azimuth=(low, high),
            pattern=pattern_in(sheet),
            min_range=sheet.min_range or 0.0,
            range_10=sheet.range_10,
            range_80=sheet.range_80,
            wavelength=1e-9 * (sheet.wavelength_nm or 905.0),
            size=sheet.size_mm and metres(sheet.size_mm),
            offsets=sheet.offsets_m,
        )

    @classmethod
    def patterned(cls, pattern: ScanPattern, **limits: Any) -> Lidar:
        """Return a LiDAR that fires the rays of `pattern`.

        `limits` are other attributes, such as `range`."""
        return cls((), 1, pattern=pattern, **limits)

    def in_frame(self, number: int) -> Lidar:
        """Return the LiDAR as it fires in frame `number`, which changes only a pattern."""
        if self.pattern is None or number % self.pattern.frames == self.frame:
            return self
        return _in_frame(self, number % self.pattern.frames)

    def at_once(self) -> Lidar:
        """Return the LiDAR as it fires all rays at the moment of the frame."""
        return replace(self, timing=None)

    def in_weather(self, weather: Weather) -> Lidar:
        """Return the LiDAR in that weather, whatever air it was in."""
        extinction = weather.extinction(self.wavelength)
        return self if extinction == self.extinction else replace(self, extinction=extinction)

    def corrected(self, by: Corrects, unit: str | None = None) -> Lidar:
        """Return the LiDAR as on a real vehicle, in clouds, `expected_recall` and requirements.

        `by` is what `read_correction` reads, `unit` the name of the LiDAR on that vehicle whose
        mask and beams apply; None: what holds for the whole vehicle alone. Raises ValueError: there
        is no such unit, or what is known of it does not fit this LiDAR."""
        return by.applied_to(self, unit)

    def nearsighted(self, factor: float) -> Lidar:
        """Return the LiDAR with all its ranges multiplied by `factor`."""
        ranges = {name: getattr(self, name) for name in ("range", "range_10", "range_80")}
        return replace(self, **{n: factor * m for n, m in ranges.items() if m is not None})

    @property
    def beams(self) -> int:
        """Number of beams; of a pattern the rays in a frame."""
        return len(self.elevations)

    @property
    def full_turn(self) -> bool:
        """Whether the field of view is the whole turn."""
        return self.azimuth[1] - self.azimuth[0] >= 2 * math.pi - HAIR

    @property
    def first_step(self) -> int:
        """First azimuth step that is fired, in [0, azimuth_steps); the next ones follow it."""
        if self.full_turn or self.pattern is not None:
            return 0
        return math.ceil((self.azimuth[0] - HAIR) / self._step) % self.azimuth_steps

    @property
    def fired_steps(self) -> int:
        """Number of azimuth steps that are fired."""
        if self.full_turn or self.pattern is not None:
            return self.azimuth_steps
        low, high = (math.ceil((end - HAIR) / self._step) for end in self.azimuth)
        return high - low

    @property
    def rays(self) -> int:
        """Number of rays, `beams * fired_steps`."""
        return self.beams * self.fired_steps

    @property
    def falloff(self) -> float:
        """Exponent k of `sight`: 1/2 is the inverse square law; less where air takes light, too."""
        if self.range_10 is None or self.range_80 is None:
            return 0.5
        return math.log(self.range_80 / self.range_10) / math.log(8.0)

    @property
    def reach(self) -> float:
        """Distance up to which surfaces return, metres, where no reflectivity is known.

        `range` is that in clear air through a clean window. For surrogates of the POG, coverage."""
        clean = self.range * self.window ** (2.0 * self.falloff)
        return float(shortened(clean, self.fading))

    @property
    def fading(self) -> float:
        """Rate, 1/m, with which `sight` of a surface at R metres is as of one at `R exp(fading R)`.

        In clear air, that is: the air leaves exp(-2 extinction R) of the light on its way out and
        back (Beer and Lambert), and what the light is worth in metres is its power of k, see
        `falloff`."""
        return 2.0 * self.falloff * self.extinction

    def sight(self, reflected: ArrayLike) -> NDArray[np.float64]:
        """Return the distance up to which surfaces return: `min(range, range_10 (light / 0.1)^k)`.

        Metres, with k such that it is `range_80` for 0.8, see `falloff`; `light` is what of the
        reflected, reflectivity times the cosine of incidence (Lambert's law), passes air and
        window. `reach` where `range_10` is not known."""
        light = np.asarray(reflected, np.float64) * self.window**2
        if self.range_10 is None:
            return np.full(light.shape, self.reach)
        clear = self.range_10 * (10.0 * light) ** self.falloff
        return np.minimum(self.range, shortened(clear, self.fading))

    @property
    def _step(self) -> float:
        return 2 * math.pi / self.azimuth_steps

    def thinned(self, share: float) -> Lidar:
        """Return the LiDAR with `share` of its azimuth steps, rounded, at least one in a turn.

        Of a pattern a share of the rays. Raises ValueError: `share` is not within (0, 1], or no
        step that is left is in the field of view."""
        if not 0 < share <= 1:
            raise InputError(key="share", expected="a number within (0, 1]", found=share)
        if share == 1:
            return self
        if self.pattern is not None:
            return replace(self, pattern=self.pattern.thinned(share))
        return replace(self, azimuth_steps=max(1, round(share * self.azimuth_steps)))

    def azimuths(self) -> NDArray[np.float64]:
        """Return the azimuths at which beams fire, in this order, radians.

        Multiples of a step, `2 pi / azimuth_steps`, in [0, 2 pi), from 0 for a full turn, else from
        the first one in the field of view: the same for all beams, shape (fired_steps,). Of a
        pattern one of each beam, ascending in [-pi, pi), shape (beams, 1)."""
        if self.pattern is not None:
            return self.pattern.of_frame(self.frame)[0][:, None]
        steps = (self.first_step + np.arange(self.fired_steps)) % self.azimuth_steps
        return steps.astype(np.float64) * self._step

    def scan_shares(self) -> NDArray[np.float64]:
        """Return at which share of its scan each ray is fired, 0 in the middle, see `ScanTiming`.

        Of all beams, shape (1, fired_steps); of a pattern of each, shape (beams, 1)."""
        if self.pattern is not None:
            return self.pattern.order_in_frame(self.frame)[:, None] - 0.5
        low, high = (-math.pi, math.pi) if self.full_turn else self.azimuth
        turned = (self.azimuths()[None] - low) % (2 * math.pi)
        return turned / (high - low) - 0.5

    def directions(self) -> NDArray[np.float64]:
        """Return unit vectors of all rays in the sensor's frame, shape (beams * fired_steps, 3).

        Rays of one beam are contiguous."""
        azimuths = self.azimuths()
        if self.azimuth_offsets is not None:
            azimuths = azimuths + np.array(self.azimuth_offsets)[:, None]
        return unit_vectors(np.asarray(self.elevations), azimuths)


class Corrects(Protocol):
    """Corrections that were learnt from recordings of a vehicle."""

    def applied_to(self, lidar: Lidar, unit: str | None) -> Lidar:
        """Return the corrected LiDAR, see `Lidar.corrected`."""


@lru_cache(maxsize=64)
def _in_frame(lidar: Lidar, number: int) -> Lidar:
    return replace(lidar, frame=number)


def unit_vectors(
    elevations: NDArray[np.float64], azimuths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return directions of rays, shape (beams * steps, 3); those of one beam are contiguous.

    Elevations are above the xy plane, shape (beams,), azimuths from the x axis towards y, of all
    beams, shape (steps,), or of each, shape (beams, steps); radians."""
    up = elevations[:, None]
    level = np.cos(up)
    x, y = level * np.cos(azimuths), level * np.sin(azimuths)
    return np.stack([x, y, np.broadcast_to(np.sin(up), x.shape)], axis=-1).reshape(-1, 3)
