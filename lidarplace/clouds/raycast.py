"""Cast the rays of a LiDAR at convex parts, the ground and the vehicle's own body.

Every ray goes to the nearest surface that it *enters*: a part around the sensor is transparent.
`cast_compiled`:

1. lets every ray meet the flat ground, its end at the rig, or nothing: `start_nearest`;
2. passes over parts that are out of reach, between two beams, or not before the crop;
3. lets rays meet the other parts where nothing nearer is met: `meet_part`;
4. turns inverse distances and numbers of parts into hits: `_fill_hits`.

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

from lidarplace.base.kernel_cache import inlined, inner, njit
from lidarplace.clouds.convex import enter_along, fill_corners, fill_planes, shorter_turn, window_of
from lidarplace.clouds.shapes import BODY, Parts
from lidarplace.rigs.correction import Correction
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, blocks

GROUND, NOTHING = -1, -6
"""Targets of rays that hit no part; parts have owners above and between."""
NO_ENDS = np.empty(0)
"""No ray ends at the rig of its LiDAR."""
HAIR = 1e-9
"""Rounding of an angle, radians."""
EVERYWHERE = (-math.inf, -math.inf, -math.inf, math.inf, math.inf, math.inf)


class Hits(NamedTuple):
    """First hit of every ray of a LiDAR, in the order of `Lidar.directions()`.

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
        """Return the hits of some rays, in the same memory."""
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
    """Cast all rays of one LiDAR.

    Range noise, drop-off, the least range and the light that a surface must return are not applied.

    `parts` are what stands around, and the vehicle's own body. Hits within the `crop` x0, y0, z0,
    x1, y1, z1, ego frame, metres, are right, for rays that meet nothing there the answer is open:
    parts that cannot matter are skipped. `into` are hits of an earlier call for the same `lidar`,
    whose memory is used again; `ends` the inverse distances at which rays end at the rig, of
    `lidarplace.clouds.shade`. `level`: whether the ground is flat, at z = 0; else there is none."""
    number = lidar.rays
    hits = into or Hits(np.empty(number), np.empty(number, np.int32), np.empty(number))
    surfaces = Surfaces(parts.geometry, parts.owner, parts.reflectivity)
    region = np.array(crop, np.float64)
    for rays, numbers in rays_of(mount, lidar):
        cast_compiled(rays, surfaces, region, ends[numbers], hits.of(numbers), level)
    return hits


class Surfaces(NamedTuple):
    """`Parts`, as compiled code takes them."""

    geometry: NDArray[np.float64]
    owner: NDArray[np.int32]
    reflectivity: NDArray[np.float64]


class Nearest(NamedTuple):
    """Nearest surface on every ray of a LiDAR.

    Attributes:
        inverse: inverse of its distance, 1/m, shape (rays,).
        part: number of the part, or GROUND, NOTHING, BODY, shape (rays,)."""

    inverse: NDArray[np.float64]
    part: NDArray[np.int32]


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


class Rays(NamedTuple):
    """Rays of a mounted LiDAR: position and rotation of the sensor in the ego frame, and beams."""

    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    beams: Beams


@lru_cache(maxsize=64)
def beams_of(lidar: Lidar) -> Beams:
    """Return the rays of `lidar`, in read-only arrays."""
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
    """Return the rays of each of the `blocks` of a LiDAR, and which of its rays they are."""
    return [
        (Rays(block_mount.position, block_mount.rotation, beams_of(block)), numbers)
        for block_mount, block, numbers in blocks(mount, lidar)
    ]


@inner
def along(beams, beam):
    """Return cosines and sines of the azimuths at which a beam fires."""
    azimuths = beams.azimuths[beam if len(beams.aimed) else 0]
    return azimuths[0], azimuths[1]


@inner
def beams_in(beams, window):
    """Return the first and past the last of the beams that may fire within a window of azimuths."""
    low, high = window.azimuth - window.right - HAIR, window.azimuth + window.left + HAIR
    if len(beams.aimed) == 0 or low < -math.pi or high > math.pi:
        return 0, len(beams.elevations)
    return np.searchsorted(beams.aimed, low), np.searchsorted(beams.aimed, high)


@inner
def runs(beams, beam, window):
    """Return first and past the last step of a beam in each of two runs that a window spans.

    There are two as it may go on at the start of the turn."""
    if len(beams.aimed):
        turn = shorter_turn(window.azimuth, beams.aimed[beam])
        return (0, int(-window.right - HAIR <= turn <= window.left + HAIR)), (0, 0)
    steps, per_step = beams.azimuths.shape[2], 2 * np.pi / beams.turn
    # One step wider than the interval on both sides, so that rounding costs nothing.
    start = int(np.floor((window.azimuth - window.right) / per_step))
    count = min(int(np.ceil((window.azimuth + window.left) / per_step)) - start + 1, beams.turn)
    start = (start - beams.first_step) % beams.turn
    return (start, min(start + count, steps)), (0, min(start + count - beams.turn, steps))


@inner
def returns_light(distance, reflected, beams):
    """Return whether a surface is neither too near nor too dark to be seen, see `Lidar.sight`."""
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
    """Return the probability that rays return from an object, past drop-off and correction.

    `rays` are their numbers, `ranges` their distances to an object of the class, metres, of the
    same shape."""
    correction = lidar.correction or Correction()
    share = correction.factors_of([object_class])[0] * np.exp(-correction.loss * ranges)
    if correction.mask is not None:
        masks = [beams_of(block).mask for _, block, _ in blocks(Mount(), lidar)]
        share = share * np.concatenate(masks)[rays]
    return np.asarray(np.minimum(share, 1.0) * (1.0 - lidar.drop_off))


@inner
def lost_share(ray, distance, factor, drop_off, beams):
    """Return the probability that the return of a ray is lost, by drop-off and by `Correction`.

    It is `drop_off` to the last bit where the correction loses nothing. What is no object has
    factor 1 and distance 0."""
    share = factor * math.exp(-beams.loss * distance)
    if len(beams.mask):
        share *= beams.mask[ray]
    return drop_off + (1.0 - min(share, 1.0)) * (1.0 - drop_off)


@njit(cache=True, nogil=True, error_model="numpy")
def cast_compiled(rays, surfaces, crop, ends, hits, level=True):
    """Fill the `hits` of `Rays` on `Surfaces`; further arguments as of `cast`."""
    origin, rotation, beams = rays
    number, steps = len(surfaces.owner), beams.azimuths.shape[2]
    nearest = Nearest(np.empty(len(hits.range)), np.empty(len(hits.range), np.int32))
    start_nearest(rays, ends, level, nearest)
    planes, facing = np.empty((number, 6, 5)), np.zeros(number, np.int64)
    corners, enter = np.empty((8, 3)), np.empty(steps)
    for part in range(number):
        fill_corners(surfaces.geometry[part], corners)
        if is_apart(corners, origin, crop):
            continue
        window = window_of(corners, origin, rotation)
        if window.nearest > beams.reach or not is_between(beams, window):
            continue
        facing[part] = fill_planes(surfaces.geometry[part], origin, rotation, planes[part])
        if facing[part] > 0:
            faces = part, facing[part], planes[part]
            meet_part(beams, window, faces, enter, nearest)
    _fill_hits(rays, surfaces, (facing, planes), nearest, level, hits)


@inlined
def height_over_ground(rays, level):
    """Return the height of the sensor over flat ground; NaN if there is none or it is not above."""
    return rays.origin[2] if level and rays.origin[2] > 0.0 else np.nan


@inlined
def start_nearest(rays, ends, level, nearest):
    """Let every ray meet the flat ground, its end at the rig, or nothing within its reach."""
    _, rotation, beams = rays
    steps, high = beams.azimuths.shape[2], height_over_ground(rays, level)
    farthest = 1.0 / beams.reach * (1.0 - 4e-16)
    for beam in range(len(beams.elevations)):
        ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
        cosines, sines = along(beams, beam)
        a, b = -rotation[2, 0] * ce / high, -rotation[2, 1] * ce / high
        c = -rotation[2, 2] * se / high
        inverse, part = nearest.inverse[beam * steps :], nearest.part[beam * steps :]
        for n in range(steps):
            ground = a * cosines[n] + b * sines[n] + c
            inverse[n] = ground if ground > farthest else farthest
            part[n] = GROUND if ground > farthest else NOTHING
        for n in range(steps if len(ends) else 0):
            end = ends[beam * steps + n]
            if end > inverse[n]:
                inverse[n], part[n] = end, BODY


@inlined
def is_apart(corners, origin, crop):
    """Return whether a part is apart from the hull of crop and sensor, axis by axis.

    The hull is convex, so it holds every ray up to a point in `crop`, and the part cannot stand
    before one."""
    apart = False
    for axis in range(3):
        low, top = min(crop[axis], origin[axis]), max(crop[axis + 3], origin[axis])
        under = over = True
        for n in range(8):
            under, over = under and corners[n, axis] < low, over and corners[n, axis] > top
        apart |= under or over
    return apart


@inlined
def is_between(beams, window):
    """Return whether a beam is in a window: what is thin, as a plate is, mostly is in none."""
    start, end = beams_in(beams, window)
    met = False
    for beam in range(start, end):
        met |= window.lowest <= beams.elevations[beam, 0] <= window.highest
    return met


@inlined
def meet_part(beams, window, faces, enter, nearest):
    """Let the rays that enter a part meet it where nothing nearer is met.

    `faces` are the number of the part, how many planes face the sensor, and the planes; `enter` is
    memory for a beam."""
    (part, facing, planes), (inverses, parts) = faces, nearest
    elevations, steps = beams.elevations, beams.azimuths.shape[2]
    start, end = beams_in(beams, window)
    spans = runs(beams, start, window)
    for beam in range(start, end):
        elevation, ce, se = elevations[beam]
        if not window.lowest <= elevation <= window.highest:
            continue
        cosines, sines = along(beams, beam)
        if len(beams.aimed):  # else those of one beam are those of all
            spans = runs(beams, beam, window)
        for first, last in spans:
            first &= ~7  # further steps make whole vectors
            last = min((last + 7) & ~7, steps)
            if first >= last:
                continue
            enter_along(cosines[first:last], sines[first:last], planes, facing, ce, se, enter)
            inverse = inverses[beam * steps + first : beam * steps + last]
            numbers = parts[beam * steps + first : beam * steps + last]
            for n in range(len(inverse)):
                nearer = enter[n] > inverse[n]
                inverse[n] = enter[n] if nearer else inverse[n]
                numbers[n] = part if nearer else numbers[n]


@inlined
def _fill_hits(rays, surfaces, faces, nearest, level, hits):
    """Turn what every ray meets into hits: range, owner and reflected light."""
    beams, (facing, planes) = rays.beams, faces
    (ranges, targets, reflected), (inverses, parts) = hits, nearest
    _, owner, reflectivity = surfaces
    steps, high = beams.azimuths.shape[2], height_over_ground(rays, level)
    for beam in range(len(beams.elevations)):
        ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
        cosines, sines = along(beams, beam)
        for n in range(steps):
            ray = beam * steps + n
            part, inverse = parts[ray], inverses[ray]
            if part < 0:
                ranges[ray] = np.inf if part == NOTHING else 1.0 / inverse
                reflected[ray] = min(inverse * high, 1.0) if part == GROUND else 0.0
                targets[ray] = part
                continue
            least, cosine = np.inf, 0.0
            for k in range(facing[part]):
                a, b = ce * planes[part, k, 0], ce * planes[part, k, 1]
                c = se * planes[part, k, 2] + planes[part, k, 3]
                inverse_to_plane = a * cosines[n] + b * sines[n] + c
                nearer = inverse_to_plane < least
                cosine = inverse_to_plane * planes[part, k, 4] if nearer else cosine
                least = min(least, inverse_to_plane)
            ranges[ray], targets[ray] = 1.0 / inverse, owner[part]
            reflected[ray] = min(cosine, 1.0) * reflectivity[part]
