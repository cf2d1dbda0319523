"""The scan pattern of a LiDAR from its clouds: elevations, offsets of lasers, steps, noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.rigs.lidar import MOST_OFFSET

NEAREST_M = 3.0
"""Least range of points that are fitted: nearer ones are of the vehicle, or bent by optics."""
LEAST_POINTS = 50
"""Least number of points of a ring."""
LEAST_RINGS = 2
MOST_RINGS = 10_000
FARTHEST_M = 10_000.0
MOST_SPREAD_DEG = 0.2
"""Largest median distance of points from the elevation of their ring, in the sensor's frame."""
LEAST_OFFSET_M = 0.02
"""Least difference of offsets that is not one of the fit."""
LEAST_STEP = 1e-4
"""Radians between two firings; the returns of one firing are nearer to each other."""
MOST_STEPS = 3
"""Largest number of steps between returns; over wide gaps it is not sure."""
SMOOTH_M = 0.15
"""A surface is smooth where its range differs by less over two steps."""
NOISE_RANGES_M = (3.0, 30.0)


@dataclass(frozen=True)
class ScanFit:
    """Scan pattern of the LiDAR that recorded some clouds.

    `rings` are their numbers in the file, by elevation from the lowest, and `elevations` theirs,
    radians; `offsets` those of the lasers along the sensor's z axis, metres, None if all start at
    one point. `azimuth_steps` are firings of a beam per turn; `range_noise` is the standard
    deviation of a range, metres, None if no smooth surface shows it; `share` that of all firings
    which returned; `range` the farthest return, metres; `rate` turns a second, None without times;
    `origin` x, y, z where the rays start, metres, near 0 in the LiDAR's frame; `left_out` the rings
    with fewer than LEAST_POINTS."""

    rings: tuple[int, ...]
    elevations: tuple[float, ...]
    offsets: tuple[float, ...] | None
    azimuth_steps: int
    range_noise: float | None
    share: float
    range: float
    rate: float | None
    origin: tuple[float, float, float]
    left_out: tuple[int, ...]


def fit_scan(clouds: Mapping[str, pd.DataFrame]) -> ScanFit:
    """Fit the pattern of one LiDAR.

    `clouds` are of one sweep each, by their files: x, y, z in the sensor's frame, metres, and ring;
    without it, rings must follow each other in the order of the points. NaN points are left out.
    `time`, seconds, is optional. Raises InputError without ring or order, for clouds that are too
    small, or not in the sensor's frame."""
    rays = pd.concat([_rays(cloud, name).assign(sweep=name) for name, cloud in clouds.items()])
    place = next(iter(clouds)) + (f" and {len(clouds) - 1} more" if len(clouds) > 1 else "")
    numbered = all("ring" in cloud for cloud in clouds.values())
    in_sweep = rays.groupby("sweep")["ring"].max() + 1
    if not numbered and in_sweep.nunique() > 1:  # nobody knows which one is missing
        wrong = "clouds without a ring column have different numbers of rings"
        found, fix = ", ".join(map(str, sorted(set(in_sweep)))), "leave out those with fewer rings"
        raise InputError(wrong, place=place, found=found, fix=fix)
    counts = rays.groupby("ring").size()
    left_out = counts.index[counts < LEAST_POINTS]
    rays = rays.loc[~rays["ring"].isin(left_out)]
    if rays["ring"].nunique() < LEAST_RINGS:
        wrong, least = "cloud too small to fit a pattern", f"{LEAST_RINGS} rings of {LEAST_POINTS}"
        found = f"{len(counts) - len(left_out)} of {int(counts.sum())} points"
        raise InputError(wrong, place=place, expected=f"{least} points", found=found)
    rings = _Rings([ring for _, ring in rays.groupby("ring")])
    numbers = rays["ring"].drop_duplicates().sort_values().to_numpy()
    elevations, offsets, spread = rings.directions()
    start = rings.origin(elevations, offsets)
    if np.degrees(spread) > MOST_SPREAD_DEG or np.linalg.norm(start) > MOST_OFFSET:
        at = ", ".join(f"{value:.2f}" for value in start)
        wide = f"elevations that spread by {np.degrees(spread):.2f} degrees"
        raise InputError(
            "cloud is not in the frame of its LiDAR",
            place=place,
            expected=f"rays that start within {MOST_OFFSET:g} m of its origin",
            found=f"a start at ({at}) m, {wide}",
            fix="name its pose with --rig or --mount",
        )
    order = np.argsort(elevations, kind="stable")
    steps = rings.azimuth_steps()
    if steps is None:
        raise InputError("points of a ring are all at one azimuth", place=place)
    x, y, z = start.tolist()
    return ScanFit(
        rings=tuple(numbers[order].tolist()),
        elevations=tuple(elevations[order].tolist()),
        offsets=None if offsets is None else tuple(offsets[order].round(3).tolist()),
        azimuth_steps=steps,
        range_noise=rings.noise(2 * np.pi / steps),
        # Sweeps may be a little more than a turn.
        share=min(len(rays) / (len(numbers) * steps * len(clouds)), 1.0),
        range=float(rays["range"].max()),
        rate=_rate([*clouds.values()]),
        origin=(x, y, z),
        left_out=tuple(left_out.tolist()),
    )


def _rays(cloud: pd.DataFrame, place: str) -> pd.DataFrame:
    """Return ring, level (distance from the z axis), z, range and azimuth of the points."""
    points = cloud[["x", "y", "z"]].to_numpy(np.float64)
    finite = np.isfinite(points).all(axis=1)
    x, y, z = points[finite].T
    farthest = np.abs(points[finite]).max(initial=0.0)
    if farthest > FARTHEST_M:
        near, found = f"coordinates within {FARTHEST_M:g} m", f"{farthest:g} m"
        raise InputError("implausible point", place=place, expected=near, found=found)
    azimuth, level = np.arctan2(y, x), np.hypot(x, y)
    ring = cloud["ring"].to_numpy()[finite] if "ring" in cloud else _rings_in_order(azimuth, place)
    if not ((ring >= 0) & (ring < MOST_RINGS) & (ring == np.round(ring))).all():
        allowed = f"whole numbers from 0 to {MOST_RINGS - 1}"
        raise InputError(place=place, key="ring", expected=allowed)
    columns = {"level": level, "z": z, "range": np.hypot(level, z), "azimuth": azimuth}
    rays = pd.DataFrame(columns | {"ring": ring.astype(np.int64)})
    return rays[rays["level"] > 0]


def _rings_in_order(azimuth: NDArray[np.float64], place: str) -> NDArray[np.int64]:
    """Return the numbers of rings that follow each other: each begins where the azimuth wraps."""
    change = np.diff(azimuth % (2 * np.pi), prepend=azimuth[:1] % (2 * np.pi))
    wraps = max(change < -np.pi, change > np.pi, key=np.count_nonzero)
    rings: NDArray[np.int64] = np.cumsum(wraps)
    sizes = np.bincount(rings)
    # In order a ring holds long runs; shuffled points wrap every few, columns hold no steps.
    runs = np.count_nonzero(sizes >= LEAST_POINTS) >= LEAST_RINGS
    if not runs or np.median(sizes) < LEAST_POINTS or np.median(np.abs(change)) < LEAST_STEP:
        wrong = "no ring column, and rings do not follow each other in the file"
        needed = "a column ring, or KITTI's order"
        found = f"{int(wraps.sum())} turns of the azimuth in {len(azimuth):,} points"
        raise InputError(wrong, place=place, expected=needed, found=found)
    return rings


class _Rings:
    """The points of every laser, a table each."""

    def __init__(self, rings: Sequence[pd.DataFrame]) -> None:
        self._all = rings
        far = [ring[ring["range"] > NEAREST_M] for ring in rings]
        self._far = [
            far_ring if len(far_ring) >= LEAST_POINTS else ring
            for far_ring, ring in zip(far, rings, strict=True)
        ]

    def directions(self) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, float]:
        """Fit elevations of the lasers, their offsets or None, and the spread about them, radians.

        Offsets, of blocks of lasers next to each other, are given if they explain half of the
        spread."""
        none = np.zeros(len(self._all))
        elevations, spread = self._elevations(none)
        order, offsets = np.argsort(elevations), none.copy()
        lines = np.array([_line(ring) for ring in self._far])
        offsets[order] = _in_blocks(lines[order])
        others, less = self._elevations(offsets)
        if less < 0.5 * spread and np.abs(offsets).max() > LEAST_OFFSET_M:
            return others, offsets, less
        return elevations, None, spread

    def origin(
        self, elevations: NDArray[np.float64], offsets: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Fit the start of the rays, x, y, z in metres, by how rings bend over azimuth.

        From (x, y) a point is nearer to the axis by x cos(azimuth) + y sin(azimuth)."""
        heights = np.zeros(len(elevations)) if offsets is None else offsets
        ring = pd.concat(
            points.assign(slope=np.tan(elevation), z=points["z"] - height)
            for points, elevation, height in zip(self._far, elevations, heights, strict=True)
        )
        slope, azimuth = ring["slope"].to_numpy(), ring["azimuth"].to_numpy()
        bent = slope * ring["level"].to_numpy() - ring["z"].to_numpy()
        sides = slope[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
        near, start = np.ones(len(bent), np.bool_), np.zeros(2)
        for _ in range(4):
            start = np.linalg.lstsq(sides[near], bent[near], rcond=None)[0]
            apart = np.abs(bent - sides @ start)
            near = apart <= 2.5 * 1.4826 * np.median(apart) + 1e-6
        return np.array([*start, np.median(heights)])

    def _elevations(self, offsets: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Return medians over each ring, and the median distance from them, radians."""
        rings = zip(self._far, offsets, strict=True)
        each = [np.arctan2(ring["z"] - offset, ring["level"]) for ring, offset in rings]
        medians = np.array([elevations.median() for elevations in each])
        apart = [(elevations - elevations.median()).abs().median() for elevations in each]
        return medians, float(np.median(apart))

    def azimuth_steps(self) -> int | None:
        """Return the steps of a turn, by those between successive returns of a laser."""
        sweeps = [
            azimuths["azimuth"] for ring in self._all for _, azimuths in ring.groupby("sweep")
        ]
        gaps = np.concatenate([np.diff(np.sort(azimuths)) for azimuths in sweeps])
        fired = gaps[gaps > LEAST_STEP]
        if not len(fired):
            return None
        step = np.median(fired[fired < 1.5 * np.quantile(fired, 0.25)])
        steps = np.round(gaps / step)
        near = steps <= MOST_STEPS
        return round(2 * np.pi * float(steps[near].sum() / gaps[near].sum()))

    def noise(self, step: float) -> float | None:
        """Return the range noise, by second differences of ranges along smooth surfaces."""
        differences = []
        for ring in self._all:
            for _, points in ring.groupby("sweep"):
                points = points.sort_values("azimuth")
                r, turns = points["range"].to_numpy(), np.diff(points["azimuth"]) / step
                single = np.abs(turns - 1) < 0.3
                smooth = single[1:] & single[:-1] & (np.abs(r[2:] - r[:-2]) < SMOOTH_M)
                smooth &= (r[1:-1] > NOISE_RANGES_M[0]) & (r[1:-1] < NOISE_RANGES_M[1])
                differences.append((r[2:] - 2 * r[1:-1] + r[:-2])[smooth])
        bends = np.concatenate(differences)
        if len(bends) < LEAST_POINTS:
            return None
        return float(1.4826 * np.median(np.abs(bends - np.median(bends))) / np.sqrt(6))


def _line(ring: pd.DataFrame) -> tuple[float, float]:
    """Fit where the line of a ring meets the z axis, metres, and how well it is known, 1/m.

    Points that are far from the line, as those of mixed returns, are left out step by step."""
    level, z = ring["level"].to_numpy(), ring["z"].to_numpy()
    near = np.ones(len(z), np.bool_)
    slope, height, width = 0.0, 0.0, 1.0
    for _ in range(6):
        mean = level[near].mean()
        width = float(((level[near] - mean) ** 2).sum())
        if near.sum() < LEAST_POINTS or width < 1.0:
            return height, 0.0
        slope = float(((level[near] - mean) * z[near]).sum() / width)
        height = float(z[near].mean() - slope * mean)
        apart = np.abs(z - slope * level - height)
        near = apart <= 2.5 * 1.4826 * np.median(apart[near]) + 1e-6
    return height, float(np.sqrt(width) / mean)


def _in_blocks(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the offset of each laser's block; a block is split where that halves the misfit.

    `lines`: offset and weight of each laser, by elevation, shape (lasers, 2)."""

    def misfit(part: NDArray[np.float64]) -> float:
        return float((np.abs(part[:, 0] - _middle(part)) * part[:, 1]).sum())

    both = [misfit(lines[:n]) + misfit(lines[n:]) for n in range(1, len(lines))]
    if both:
        n = int(np.argmin(both)) + 1
        apart = abs(_middle(lines[:n]) - _middle(lines[n:]))
        if apart > LEAST_OFFSET_M and both[n - 1] < 0.5 * misfit(lines):
            return np.concatenate([_in_blocks(lines[:n]), _in_blocks(lines[n:])])
    return np.full(len(lines), _middle(lines))


def _middle(lines: NDArray[np.float64]) -> float:
    """Return the weighted median of offsets."""
    order = np.argsort(lines[:, 0])
    weights = lines[order, 1].cumsum()
    return float(lines[order[np.searchsorted(weights, 0.5 * weights[-1])], 0])


def _rate(clouds: Sequence[pd.DataFrame]) -> float | None:
    """Return turns a second by the median time of a sweep."""
    times = [np.ptp(cloud["time"].dropna()) for cloud in clouds if "time" in cloud]
    return float(1 / np.median(times)) if times and min(times) > 0 else None
