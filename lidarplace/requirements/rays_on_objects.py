"""Counts of the rays of LiDARs that hit objects, past their vehicle and each other.

Counts are exact for each object alone: others hide nothing. They are expected ones: a ray counts as
a point with the probability p that it returns, and a cell with `1 - product of (1 - p)` over the
rays that hit it."""

from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import inner, njit
from lidarplace.clouds.convex import enter_along, fill_corners, fill_planes, window_of
from lidarplace.clouds.raycast import (
    Beams,
    along,
    beams_in,
    beams_of,
    lost_share,
    returns_light,
    runs,
)
from lidarplace.clouds.shade import ends_of
from lidarplace.clouds.shapes import bricks
from lidarplace.mounting.housing import as_housings, housings_in, without
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.surface_cells import slices_of
from lidarplace.requirements.requirement import DARK
from lidarplace.rigs.correction import OTHER, Correction
from lidarplace.rigs.placement import Placement, blocks

MOST_CELLS = 10_000_000  # of one object

_MOST_BYTES = 2**27  # of who hits which cell, for the objects that a thread takes at a time


class Sight(NamedTuple):
    """A LiDAR on the vehicle, as compiled code takes it.

    One with offsets has a sight for each block of its lasers. Rays end at the body, at another
    LiDAR or for want of range."""

    number: int  # of the LiDAR in its rig
    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    beams: Beams
    least: NDArray[np.float64]  # 1 / distance at which every ray ends, 1/m, shape (rays,)
    lossy: bool  # whether returns are lost at random
    drop_off: float  # probability of a loss without a correction
    factor: float  # of `Correction` for the objects


def sights_of(placement: Placement, vehicle: Vehicle) -> list[Sight]:
    """Return the LiDARs of a rig, for objects of no class; see `at_class`."""
    housings, body, sights = housings_in(placement), as_housings(vehicle.interior), []
    for number, (mount, lidar) in enumerate(zip(placement.mounts, placement.lidars, strict=True)):
        ends = ends_of(mount, lidar, np.concatenate([without(housings, number), body]), vehicle)
        lossy = lidar.correction is not None or lidar.drop_off > 0
        for origin, block, numbers in blocks(mount, lidar):
            beams, at = beams_of(block), (origin.position, origin.rotation)
            least = np.full(block.rays, 1.0 / beams.reach * (1.0 - 4e-16))
            if len(ends):
                np.maximum(least, ends[numbers], out=least)
            sights.append(Sight(number, *at, beams, least, lossy, lidar.drop_off, 1.0))
    return at_class(sights, placement, None)


def at_class(sights: list[Sight], placement: Placement, object_class: str | None) -> list[Sight]:
    """Return the LiDARs of a rig for objects of a class; None: of none that a correction has."""
    corrections = [lidar.correction or Correction() for lidar in placement.lidars]
    factors = [
        float(correction.factors_of([object_class or OTHER])[0]) for correction in corrections
    ]
    return [sight._replace(factor=factors[sight.number]) for sight in sights]


def count_points(
    sights: list[Sight],
    boxes: NDArray[np.float64],
    reflectivity: float = DARK,
    sets: Sequence[Collection[int]] | None = None,
) -> NDArray[np.float64]:
    """Count rays that hit each box, a row of `lidarplace.logs.boxes.GEOMETRY`, and return.

    By its reflectivity for LiDARs whose `range_10` is known. A column for each of `sets` of numbers
    of LiDARs that count, by default for all of them together, shape (B, sets)."""
    of_set = _marked(sets, sights)

    def points(part: NDArray[np.float64]) -> NDArray[np.float64]:
        no_cells, counts = np.empty((len(part), 0)), np.zeros((len(part), of_set.shape[1]))
        for sight in sights:
            counts[:, sight.number] += _hit(sight, part, reflectivity, 1.0, no_cells)
        return counts

    return np.asarray(_in_threads(points, boxes) @ of_set.T.astype(np.float64))


def count_cells(
    sights: list[Sight],
    boxes: NDArray[np.float64],
    cell: float,
    reflectivity: float = DARK,
    sets: Sequence[Collection[int]] | None = None,
) -> NDArray[np.float64]:
    """Count cells of the surface of each box that are hit, as in `lidarplace.recall.surface_cells`.

    Boxes are of one size, `cell` is an edge in metres, the rest is as of `count_points`.
    Raises ValueError: a box has too many cells."""
    cells, of_set = _cells_of(boxes, cell), _marked(sets, sights)

    def expected(part: NDArray[np.float64]) -> NDArray[np.float64]:
        missed = np.ones((of_set.shape[1], len(part), cells))
        for sight in sights:
            _hit(sight, part, reflectivity, cell, missed[sight.number])
        return _expected(missed, of_set)

    most = max(1, min(1024, _MOST_BYTES // (8 * of_set.shape[1] * cells)))
    return _in_threads(expected, boxes, most)


def _marked(sets: Sequence[Collection[int]] | None, sights: list[Sight]) -> NDArray[np.bool_]:
    """Return whether each set has each LiDAR, shape (sets, LiDARs)."""
    every = range(sights[-1].number + 1)
    sets = [every] if sets is None else sets
    return np.array([[n in numbers for n in every] for numbers in sets], np.bool_)


def missed_cells(
    sights: list[Sight], boxes: NDArray[np.float64], cell: float, reflectivity: float = DARK
) -> NDArray[np.float64]:
    """Return the probability that no ray returns from each cell of each box, shape (B, cells).

    Arguments and errors are those of `count_cells`."""
    cells = _cells_of(boxes, cell)

    def missed(part: NDArray[np.float64]) -> NDArray[np.float64]:
        shares = np.ones((len(part), cells))
        for sight in sights:
            _hit(sight, part, reflectivity, cell, shares)
        return shares

    return _in_threads(missed, boxes)


def _cells_of(boxes: NDArray[np.float64], cell: float) -> int:
    cells = int(slices_of(boxes[:1], cell).prod())
    if cells > MOST_CELLS:
        most, fix = f"at most {MOST_CELLS:,}", "make it smaller, or ask for points"
        number = f"{cells:,} of {cell:g} m"
        raise InputError(key="cells of an object", expected=most, found=number, fix=fix)
    return cells


def _in_threads(
    work: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    boxes: NDArray[np.float64],
    portion: int = 1024,
) -> NDArray[np.float64]:
    """Call `work` on the parts that boxes are, which threads take by portions."""
    parts = [bricks(boxes[at : at + portion], 0).geometry for at in range(0, len(boxes), portion)]
    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        return np.concatenate(list(threads.map(work, parts)))


@njit(cache=True, nogil=True, error_model="numpy")
def _hit(sight, parts, reflectivity, cell, missed):
    """Count the rays of one LiDAR that hit each of `parts` and return.

    `missed` is multiplied with the probability that none returns from a cell, shape (parts, cells),
    no cells for points alone. For each part, beam and run of azimuths that can meet it: rays enter
    the part, those too dim or too near go, and what is left counts."""
    origin, rotation, beams, least = sight.origin, sight.rotation, sight.beams, sight.least
    steps = beams.azimuths.shape[2]
    corners, planes, enter = np.empty((8, 3)), np.empty((6, 5)), np.empty(steps)
    expected, frame = np.zeros(len(parts)), np.empty((3, 4))
    for p in range(len(parts)):
        framed, shape = False, (1, 1, 1)
        fill_corners(parts[p], corners)
        window = window_of(corners, origin, rotation)
        if window.nearest > beams.reach:
            continue
        facing = fill_planes(parts[p], origin, rotation, planes)
        if facing == 0:
            continue
        for beam in range(*beams_in(beams, window)):
            if not window.lowest <= beams.elevations[beam, 0] <= window.highest:
                continue
            ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
            cosines, sines = along(beams, beam)
            for first, last in runs(beams, beam, window):
                if first >= last:
                    continue
                fired = cosines[first:last], sines[first:last], ce, se
                enter_along(fired[0], fired[1], planes, facing, ce, se, enter)
                ray, ends = beam * steps + first, least[beam * steps + first : beam * steps + last]
                if beams.sight_10 < np.inf:
                    _put_out(enter, ends, fired, planes, facing, reflectivity, beams)
                met, expected[p] = _count_returns(sight, enter, ends, ray, expected[p])
                if met == 0 or missed.shape[1] == 0:
                    continue
                if not framed:
                    shape, framed = _frame(sight, parts[p], cell, frame), True
                _mark_cells(sight, enter, ray, fired, frame, shape, missed[p])
    return expected


@inner
def _count_returns(sight, enter, ends, ray, expected):
    """Return how many of a run of rays meet a part, and `expected` plus their returns.

    The run starts with the LiDAR's ray number `ray`. Rays that meet the part nearer than the least
    range are put out."""
    most, met = 1.0 / sight.beams.nearest if sight.beams.nearest > 0.0 else np.inf, 0
    for n in range(len(ends)):
        enter[n] = enter[n] if enter[n] <= most else 0.0
        met += enter[n] > ends[n]
    if not sight.lossy:
        return met, expected + met
    for n in range(len(ends)):
        if enter[n] > ends[n]:
            expected += 1.0 - _lost(sight, ray + n, enter[n])
    return met, expected


@inner
def _mark_cells(sight, enter, ray, fired, frame, shape, missed):
    """Multiply `missed` of the cells that a run of rays hits with the probability of a loss.

    The run starts with the LiDAR's ray number `ray`; `missed` is of one part."""
    cosines, sines, ce, se = fired
    x0, x1, x2 = frame[0, 0], frame[0, 1], frame[0, 2] * se
    y0, y1, y2 = frame[1, 0], frame[1, 1], frame[1, 2] * se
    z0, z1, z2 = frame[2, 0], frame[2, 1], frame[2, 2] * se
    for n in range(len(cosines)):
        if enter[n] <= sight.least[ray + n]:
            continue
        reach, dx, dy = 1.0 / enter[n], ce * cosines[n], ce * sines[n]
        i = _slice(frame[0, 3] + reach * (x0 * dx + x1 * dy + x2), shape[0])
        j = _slice(frame[1, 3] + reach * (y0 * dx + y1 * dy + y2), shape[1])
        k = _slice(frame[2, 3] + reach * (z0 * dx + z1 * dy + z2), shape[2])
        missed[(i * shape[1] + j) * shape[2] + k] *= _lost(sight, ray + n, enter[n])


@inner
def _lost(sight, ray, inverse):
    """Return the probability that the return of a ray is lost, at this inverse distance."""
    if not sight.lossy:
        return 0.0
    return lost_share(ray, 1.0 / inverse, sight.factor, sight.drop_off, sight.beams)


@inner
def _put_out(enter, ends, fired, planes, facing, reflectivity, beams):
    """Let rays miss that meet too little light, by Lambert's law at the face that each enters.

    `fired`: cosines and sines of their azimuths, and of their elevation."""
    cosines, sines, ce, se = fired
    for n in range(len(ends)):
        if enter[n] <= ends[n]:
            continue
        least, cosine = np.inf, 0.0
        for k in range(facing):
            a, b, c = ce * planes[k, 0], ce * planes[k, 1], se * planes[k, 2] + planes[k, 3]
            entry = a * cosines[n] + b * sines[n] + c
            cosine = entry * planes[k, 4] if entry < least else cosine
            least = min(least, entry)
        if not returns_light(1.0 / enter[n], reflectivity * min(cosine, 1.0), beams):
            enter[n] = 0.0


@inner
def _frame(sight, part, cell, frame):
    """Fill `frame`, from the sensor's frame to that of the cells, whose edge is the unit of length.

    Its last column is where the sensor is. Returns the number of cells along each axis."""
    c, s = np.cos(part[6]), np.sin(part[6])
    turn, at = sight.rotation, sight.origin - part[:3]
    for k in range(4):
        x, y, z = (turn[0, k], turn[1, k], turn[2, k]) if k < 3 else (at[0], at[1], at[2])
        frame[0, k], frame[1, k], frame[2, k] = c * x + s * y, c * y - s * x, z
    for axis in range(3):
        frame[axis, 3] += 0.5 * part[3 + axis]
        for k in range(4):
            frame[axis, k] /= cell
    slices = np.maximum(np.ceil(part[3:6] / cell - 1e-9), 1.0)
    return int(slices[0]), int(slices[1]), int(slices[2])


@inner
def _slice(place, number):
    return min(max(int(np.floor(place)), 0), number - 1)


@njit(cache=True, nogil=True)
def _expected(missed, sets) -> NDArray[np.float64]:
    """Count cells that some LiDAR of each set (sets, LiDARs) hits.

    `missed` has shape (LiDARs, parts, cells)."""
    lidars, parts, cells = missed.shape
    counts = np.zeros((parts, len(sets)))
    for p in range(parts):
        for c in range(cells):
            if missed[:, p, c].min() == 1.0:
                continue
            for row in range(len(sets)):
                left = 1.0
                for number in range(lidars):
                    left *= missed[number, p, c] if sets[row, number] else 1.0
                counts[p, row] += 1.0 - left
    return counts
