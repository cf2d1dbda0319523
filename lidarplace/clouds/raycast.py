"""Cast the rays of a LiDAR at convex parts, the ground and the vehicle's own body.

Every ray goes to the nearest surface that it *enters*: a part around the sensor is transparent.

A part is the common inside of six planes. For a sensor at a signed distance D outside of a plane
with unit normal n, a ray along d meets it at the distance D / -(n d), so the inverse distance is
linear in d, and along one beam linear in the cosine and sine of the azimuth. A ray enters the part
if the least inverse distance to the planes that face the sensor is at least the largest one to the
others. So the loops over azimuths have neither divisions nor branches and become vector code. A
part costs only the beams and azimuths that can meet it."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.clouds.convex import enter_along, fill_corners, fill_planes, shorter_turn, window
from lidarplace.clouds.shapes import BODY, Parts
from lidarplace.rigs.correction import Correction
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, blocks

GROUND, NOTHING = -1, -6
"""What a ray hit when it was no part; parts have owners above and between."""
NO_ENDS = np.empty(0)
"""No ray ends at the rig of its LiDAR."""
HAIR = 1e-9
"""Rounding of an angle, radians."""
EVERYWHERE = (-math.inf, -math.inf, -math.inf, math.inf, math.inf, math.inf)


class Hits(NamedTuple):
    """What every ray of a LiDAR meets first, in the order of `Lidar.directions()`.

    Attributes:
        range: metres, `inf` where nothing is met within the LiDAR's range, shape (rays,), float64.
        target: owner of the part (row of an object, BUILDING, SIGN, BODY), or GROUND, WORLD,
            NOTHING, shape (rays,), int32. What is at least WORLD returns light.
        reflected: cosine between ray and surface normal times reflectivity, of the ground the
            cosine alone, 0 where nothing is met, shape (rays,), float64."""

    range: NDArray[np.float64]
    target: NDArray[np.int32]
    reflected: NDArray[np.float64]

    def of(self, rays: slice) -> "Hits":
        """Those of some of the rays, in the same memory."""
        return Hits(self.range[rays], self.target[rays], self.reflected[rays])


def cast(
    mount: Mount,
    lidar: Lidar,
    parts: Parts,
    crop: Sequence[float] = EVERYWHERE,
    into: Hits | None = None,
    ends: NDArray[np.float64] = NO_ENDS,
    level: bool = True,
) -> Hits:
    """Cast all rays of one LiDAR: range noise, drop-off, the least range and what is too dark to
    return light are not applied.

    `parts` are what stands around, and the vehicle's own body. Hits within the `crop` x0, y0, z0,
    x1, y1, z1, ego frame, metres, are right, for rays that meet nothing there the answer is open:
    parts that cannot matter are skipped. `into` are hits of an earlier call for the same `lidar`,
    whose memory is used again; `ends` the inverse distances at which rays end at the rig, of
    `lidarplace.clouds.shade`. `level`: whether the ground is flat, at z = 0; else there is none."""
    number = lidar.rays
    hits = into or Hits(np.empty(number), np.empty(number, np.int32), np.empty(number))
    surfaces = parts.geometry, parts.owner, parts.reflectivity, np.array(crop, np.float64)
    for rays, numbers in rays_of(mount, lidar):
        cast_compiled(*rays, *surfaces, ends[numbers], hits.of(numbers), level)
    return hits


class Beams(NamedTuple):
    """The rays of a LiDAR, as compiled code takes them.

    Attributes:
        elevations: angle, cosine and sine, shape (beams, 3).
        azimuths: cosine and sine of those fired, shape (1, 2, fired_steps); of a pattern each
            beam's own, shape (beams, 2, 1).
        aimed: azimuth of each beam of a pattern, ascending in [-pi, pi), shape (beams,); else
            empty.
        first_step, turn: the first azimuth fired, and the steps of a full turn.
        reach, nearest: of a ray, and of a return at least, metres.
        sight_10, falloff, fading: of `Lidar.sight`, the first through its window; infinite where
            light does not limit.
        mask: share of each ray that returns by its direction, shape (rays,); empty: all do.
        loss: of `Correction`, 1/m; 0: none."""

    elevations: NDArray[np.float64]
    azimuths: NDArray[np.float64]
    aimed: NDArray[np.float64]
    first_step: int
    turn: int
    reach: float
    nearest: float
    sight_10: float
    falloff: float
    fading: float
    mask: NDArray[np.float64]
    loss: float


Rays = tuple[NDArray[np.float64], NDArray[np.float64], Beams]
"""As compiled code takes them: position and rotation of the sensor in the ego frame, and beams."""


@lru_cache(maxsize=64)
def beams_of(lidar: Lidar) -> Beams:
    """The rays of `lidar`, in read-only arrays."""
    elevation = np.asarray(lidar.elevations)
    azimuth = np.atleast_2d(lidar.azimuths())
    elevations = np.stack([elevation, np.cos(elevation), np.sin(elevation)], axis=1)
    azimuths = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    aimed = np.empty(0) if lidar.pattern is None else azimuth[:, 0].copy()
    correction = lidar.correction or Correction()
    mask = np.empty(0)
    if correction.mask is not None:
        mask = correction.mask.at(*np.broadcast_arrays(azimuth, elevation[:, None])).reshape(-1)
    for table in (elevations, azimuths, aimed, mask):
        table.flags.writeable = False  # shared by all callers
    reach, sight_10 = lidar.reach, math.inf
    if lidar.range_10 is not None:
        reach, sight_10 = lidar.range, lidar.range_10 * lidar.window ** (2.0 * lidar.falloff)
    fired = elevations, azimuths, aimed, lidar.first_step, lidar.azimuth_steps
    limits = reach, lidar.min_range, sight_10, lidar.falloff, lidar.fading
    return Beams(*fired, *limits, mask, correction.loss)


def rays_of(mount: Mount, lidar: Lidar) -> list[tuple[Rays, slice]]:
    """The rays of each of the `blocks` of a LiDAR, and which of its rays they are."""
    return [
        ((own_mount.position, own_mount.rotation, beams_of(own)), numbers)
        for own_mount, own, numbers in blocks(mount, lidar)
    ]


@inner
def along(beams, beam):
    """Cosines and sines of the azimuths at which a beam fires."""
    own = beams.azimuths[beam if len(beams.aimed) else 0]
    return own[0], own[1]


@inner
def beams_in(beams, middle, below, above):
    """First and last of the beams that may fire within a window of azimuths."""
    low, high = middle - below - HAIR, middle + above + HAIR
    if len(beams.aimed) == 0 or low < -math.pi or high > math.pi:
        return 0, len(beams.elevations)
    return np.searchsorted(beams.aimed, low), np.searchsorted(beams.aimed, high)


@inner
def runs(beams, beam, middle, below, above):
    """First and last azimuth step of a beam in the two runs that a window of azimuths spans, as it
    may go on at the start of the turn."""
    if len(beams.aimed):
        turn = shorter_turn(middle, beams.aimed[beam])
        return (0, int(-below - HAIR <= turn <= above + HAIR)), (0, 0)
    steps, per_step = beams.azimuths.shape[2], 2 * np.pi / beams.turn
    # One step wider than the interval on both sides, so that rounding costs nothing.
    start = int(np.floor((middle - below) / per_step))
    count = min(int(np.ceil((middle + above) / per_step)) - start + 1, beams.turn)
    start = (start - beams.first_step) % beams.turn
    return (start, min(start + count, steps)), (0, min(start + count - beams.turn, steps))


@inner
def returns_light(distance, reflected, beams):
    """Whether a surface is neither too near nor too dark to be seen, see `Lidar.sight`."""
    if distance < beams.nearest:
        return False
    if beams.sight_10 == math.inf:
        return True
    if beams.fading > 0.0:
        distance *= math.exp(beams.fading * distance)
    return distance <= beams.sight_10 * (10.0 * reflected) ** beams.falloff


def expected_share(
    lidar: Lidar, object_class: str, rays: NDArray[np.int64], ranges: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Probability that `rays`, by their numbers, return from an object of a class at `ranges`,
    metres, of the same shape, past drop-off and correction."""
    beams, correction = beams_of(lidar), lidar.correction or Correction()
    share = correction.factors_of([object_class])[0] * np.exp(-beams.loss * ranges)
    if len(beams.mask):
        share = share * beams.mask[rays]
    return np.asarray(np.minimum(share, 1.0) * (1.0 - lidar.drop_off))


@inner
def lost_share(ray, distance, factor, drop_off, beams):
    """Probability that the return of a ray is lost, by drop-off and by `Correction`; `drop_off` to
    the last bit where the correction loses nothing. What is no object has factor 1 and distance
    0."""
    share = factor * math.exp(-beams.loss * distance)
    if len(beams.mask):
        share *= beams.mask[ray]
    return drop_off + (1.0 - min(share, 1.0)) * (1.0 - drop_off)


@njit(cache=True, nogil=True, error_model="numpy")
def cast_compiled(
    origin, rotation, fired, parts, owners, reflectivities, crop, ends, hits, level=True
):
    """Fill the `hits` of the `Beams` that are fired; arguments as of `cast`.

    Parts apart from the hull of crop and sensor are skipped: the hull is convex, so it holds every
    ray up to a point in `crop`, and they cannot stand before one."""
    elevations, reach = fired.elevations, fired.reach
    ranges, targets, reflected = hits
    beams, steps = len(elevations), fired.azimuths.shape[2]
    # Until the end `ranges` holds inverse distances and `targets` rows of `parts`.
    farthest = 1.0 / reach * (1.0 - 4e-16)
    high = origin[2] if level and origin[2] > 0.0 else np.nan  # at or below it there is none
    for beam in range(beams):
        ce, se = elevations[beam, 1], elevations[beam, 2]
        cosines, sines = along(fired, beam)
        a, b = -rotation[2, 0] * ce / high, -rotation[2, 1] * ce / high
        c = -rotation[2, 2] * se / high
        best, which = ranges[beam * steps :], targets[beam * steps :]
        for n in range(steps):
            ground = a * cosines[n] + b * sines[n] + c
            best[n] = ground if ground > farthest else farthest
            which[n] = GROUND if ground > farthest else NOTHING
        for n in range(steps if len(ends) else 0):
            end = ends[beam * steps + n]
            if end > best[n]:
                best[n], which[n] = end, BODY

    number = len(parts)
    planes = np.empty((number, 6, 5))
    facing = np.zeros(number, np.int64)
    enter = np.empty(steps)
    corners = np.empty((8, 3))
    for p in range(number):
        fill_corners(parts[p], corners)
        apart = False
        for axis in range(3):
            low, top = min(crop[axis], origin[axis]), max(crop[axis + 3], origin[axis])
            under = over = True
            for n in range(8):
                under, over = under and corners[n, axis] < low, over and corners[n, axis] > top
            apart |= under or over
        if apart:
            continue
        middle, below, above, lowest, highest, near, _ = window(corners, origin, rotation)
        met = False  # what is thin, as a plate is, mostly lies between two beams
        start, end = beams_in(fired, middle, below, above)
        for beam in range(start, end):
            met |= lowest <= elevations[beam, 0] <= highest
        if near > reach or not met:
            continue
        facing[p] = fill_planes(parts[p], origin, rotation, planes[p])
        if facing[p] == 0:
            continue
        spans = runs(fired, start, middle, below, above)
        for beam in range(start, end):
            if not lowest <= elevations[beam, 0] <= highest:
                continue
            cosines, sines = along(fired, beam)
            if len(fired.aimed):  # else those of one beam are those of all
                spans = runs(fired, beam, middle, below, above)
            for first, last in spans:
                first &= ~7  # further steps make whole vectors
                last = min((last + 7) & ~7, steps)
                if first >= last:
                    continue
                ce, se = elevations[beam, 1], elevations[beam, 2]
                enter_along(
                    cosines[first:last], sines[first:last], planes[p], facing[p], ce, se, enter
                )
                best = ranges[beam * steps + first : beam * steps + last]
                which = targets[beam * steps + first : beam * steps + last]
                for n in range(len(best)):
                    nearer = enter[n] > best[n]
                    best[n] = enter[n] if nearer else best[n]
                    which[n] = p if nearer else which[n]

    for beam in range(beams):
        ce, se = elevations[beam, 1], elevations[beam, 2]
        cosines, sines = along(fired, beam)
        for n in range(steps):
            ray = beam * steps + n
            p, inverse = targets[ray], ranges[ray]
            if p == NOTHING:
                ranges[ray], reflected[ray] = np.inf, 0.0
                continue
            ranges[ray] = 1.0 / inverse
            if p == BODY:
                reflected[ray] = 0.0
                continue
            if p == GROUND:
                reflected[ray] = min(inverse * high, 1.0)
                continue
            least, cosine = np.inf, 0.0
            for k in range(facing[p]):
                a, b = ce * planes[p, k, 0], ce * planes[p, k, 1]
                c = se * planes[p, k, 2] + planes[p, k, 3]
                here = a * cosines[n] + b * sines[n] + c
                cosine = here * planes[p, k, 4] if here < least else cosine
                least = min(least, here)
            targets[ray] = owners[p]
            reflected[ray] = min(cosine, 1.0) * reflectivities[p]
