"""Points from hits: drop-off, range noise, intensity and the cut to a region.

Random numbers are hashes of seed, frame, LiDAR and ray. So a point does not depend on which frames
are collected with it, in which order or by how many workers."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inlined, inner, njit
from lidarplace.clouds.ground import CELL_M, Ground
from lidarplace.clouds.hashed import key_of, stream_of, uniform
from lidarplace.clouds.raycast import (
    GROUND,
    NOTHING,
    Hits,
    along,
    lost_share,
    rays_of,
    returns_light,
)
from lidarplace.clouds.shapes import WORLD
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount

ATTENUATION_PER_M = 0.004
"""Fall of the intensity with range, CARLA's default `atmosphere_attenuation_rate`."""
LARGEST_ERROR = 8.3
"""No range errs by more standard deviations: the normal quantile of 2**-53 is -8.21."""


class CloudPart(NamedTuple):
    """Part of one LiDAR in the cloud of a frame.

    Attributes:
        key: seed, frame and index of the LiDAR; with the ray it decides drop-off and noise.
        lift: height by which points are raised before the cut, metres.
        classes: of objects by the number that hits have of them, for a correction; what has another
            number is not an object to it.
        poses: of the vehicle at the moment of each ray, of `lidarplace.clouds.moving.poses_at`, if
            points are moved to where it sees them at the moment of the frame; None: they stay."""

    key: tuple[int, int, int]
    lift: float = 0.0
    classes: Sequence[str] = ()
    poses: NDArray[np.float64] | None = None


def sample_points(
    mount: Mount,
    lidar: Lidar,
    hits: Hits,
    ground: Ground,
    crop: Sequence[float],
    part: CloudPart,
    points: NDArray[np.float32],
) -> int:
    """Write the points that one LiDAR returns from within `crop`; return their number.

    A return is lost with probability `lidar.drop_off`, or more by `lidar.correction`: one number of
    each ray decides, so what a correction leaves is part of what returns without. Its range errs by
    a normal of standard deviation `lidar.range_noise`, along the ray. Intensity is the light
    reflected, in terms of a white diffuser that faces the ray, times `exp(-ATTENUATION_PER_M *
    range)` and what air and window leave of it; at 1, where retroreflectors are, it saturates. Own
    body returns nothing, nor does what is nearer than `lidar.min_range` or, by the light reflected,
    beyond `lidar.sight`.

    `mount` and `lidar` are as cast for the `hits`, `crop` is x0, y0, z0, x1, y1, z1 in the ego
    frame, metres, its faces included. x, y, z and intensity go to the first rows of `points`,
    float32, (rays or more, 4), in the order of the rays."""
    x0, y0, z0, x1, y1, z1 = (float(bound) for bound in crop)
    region = _Region((x0, y0, z0, x1, y1, z1), part.lift, GROUND if ground.level else NOTHING)
    dimming = ATTENUATION_PER_M + 2.0 * lidar.extinction, lidar.window**2
    x, y, yaw = ground.pose
    turn = math.cos(yaw) / CELL_M, math.sin(yaw) / CELL_M
    cells = _GroundCells(ground.reflectivity, x / CELL_M, y / CELL_M, *turn)
    factors = np.empty(0)
    if lidar.correction is not None:
        factors = lidar.correction.factors_of(part.classes)
    chance = _Chance(
        noise=float(lidar.range_noise),
        drop_off=lidar.drop_off,
        key=key_of(*part.key),
        first_ray=0,
        corrected=lidar.correction is not None,
        factors=factors,
    )
    count = 0
    for rays, numbers in rays_of(mount, lidar):
        of_block = chance._replace(first_ray=numbers.start)
        block_hits = hits.of(numbers)
        free = points[count:]
        count += _sample(rays, block_hits, region, cells, of_block, dimming, free, part.poses)
    return count


# Coefficients of the normal quantile, from the constant term on (Wichura 1988, AS 241, PPND7).
_CENTRE = (3.3871327179, 50.434271938, 159.29113202, 59.109374720)
_CENTRE_BELOW = (1.0, 17.895169469, 78.757757664, 67.187563600)
_FLANK = (1.4234372777, 2.7568153900, 1.3067284816, 0.17023821103)
_FLANK_BELOW = (1.0, 0.73700164250, 0.12021132975, 0.0)
_TAIL = (6.6579051150, 3.0812263860, 0.42868294337, 0.017337203997)
_TAIL_BELOW = (1.0, 0.24197894225, 0.012258202635, 0.0)


@inner
def _ratio(numerator, denominator, r):
    """Return the quotient of two cubic polynomials."""
    top = ((numerator[3] * r + numerator[2]) * r + numerator[1]) * r + numerator[0]
    return top / (((denominator[3] * r + denominator[2]) * r + denominator[1]) * r + denominator[0])


@inner
def _fill_normals(uniforms, count, flank):
    """Turn the first `count` of uniform numbers into standard normals, right to seven digits.

    Inverting the distribution takes no calls but in the flanks, where a sixth of the numbers lies.
    `flank` is memory for their indices."""
    flanks = 0
    for n in range(count):
        flank[flanks] = n
        flanks += abs(uniforms[n] - 0.5) > 0.425
    for i in range(flanks):
        n = flank[i]
        u = uniforms[n]
        r = math.sqrt(-math.log(min(u, 1.0 - u)))
        if r <= 5.0:
            value = _ratio(_FLANK, _FLANK_BELOW, r - 1.6)
        else:
            value = _ratio(_TAIL, _TAIL_BELOW, r - 5.0)
        # Beyond 1, so that the next loop knows it from a uniform number.
        uniforms[n] = math.copysign(value + 2.0, u - 0.5)
    for n in range(count):
        u = uniforms[n]
        q = u - 0.5
        centre = q * _ratio(_CENTRE, _CENTRE_BELOW, 0.180625 - q * q)
        uniforms[n] = centre if abs(q) <= 0.425 else u - math.copysign(2.0, u)


class _Region(NamedTuple):
    """Crop of a cloud: x0, y0, z0, x1, y1, z1, metres; z is raised by `lift` before the cut.

    What hits the `flat` target is at z = 0."""

    crop: tuple[float, float, float, float, float, float]
    lift: float
    flat: int


class _GroundCells(NamedTuple):
    """Reflectivity of the ground by cells, and the ego frame in it.

    x, y are its origin in cells, c, s the cosine and sine of its yaw in cells a metre."""

    reflectivity: NDArray[np.float32]
    x: float
    y: float
    c: float
    s: float


class _Chance(NamedTuple):
    """Losses and errors at random: range noise, drop-off, key, number of the first ray, correction.

    `factors` are those of the correction by object; there is none unless `corrected`."""

    noise: float
    drop_off: float
    key: NDArray[np.uint64]
    first_ray: int
    corrected: bool
    factors: NDArray[np.float64]


class _Line(NamedTuple):
    """Directions of a beam, linear in cosine and sine of the azimuth, from a start; metres."""

    x: tuple[float, float, float]
    y: tuple[float, float, float]
    z: tuple[float, float, float]
    start: tuple[float, float, float]


@inlined
def _line_of(rays, beam, lift):
    """Return the `_Line` of a beam, raised by `lift`."""
    origin, r, beams = rays
    ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
    x, y = (ce * r[0, 0], ce * r[0, 1], se * r[0, 2]), (ce * r[1, 0], ce * r[1, 1], se * r[1, 2])
    z = ce * r[2, 0], ce * r[2, 1], se * r[2, 2]
    return _Line(x, y, z, (origin[0], origin[1], origin[2] + lift))


@inlined
def _toward(axis, cosine, sine):
    """Return a coordinate of the direction of a ray."""
    return axis[0] * cosine + axis[1] * sine + axis[2]


@inlined
def _poses_along(poses, beams, beam):
    """Return the poses of the vehicle at the steps of a beam."""
    if poses is None:
        return None
    return poses[beam if len(beams.aimed) else 0]


@inlined
def _moved(x, y, poses, step):
    """Return a place in the frame of the vehicle at a step in that of the frame's moment."""
    if poses is None:
        return x, y
    c, s = poses[0, step], poses[1, step]
    return poses[2, step] + c * x - s * y, poses[3, step] + s * x + c * y


@inlined
def _is_within(x, y, z, crop, slack):
    """Return whether a point is in a crop, grown by `slack`."""
    within = (x >= crop[0] - slack) & (x <= crop[3] + slack) & (y >= crop[1] - slack)
    within &= (y <= crop[4] + slack) & (z >= crop[2] - slack) & (z <= crop[5] + slack)
    return within


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(rays, hits, region, ground, chance, dimming, points, poses) -> int:
    """Write the returns within a region to `points` and return their number; `poses` may be None.

    Beam by beam, in short loops over arrays without branches: list the steps that are within the
    region, or may err into it; drop lost returns; draw errors; write the points."""
    (ranges, targets, reflected), beams = hits, rays.beams
    steps, stream = beams.azimuths.shape[2], stream_of(chance.key)
    inside = np.empty(steps, np.bool_)
    # Unsigned indices: numba need not ask whether they count from the end.
    kept_steps, flank = np.empty(steps, np.uint32), np.empty(steps, np.uint32)
    errors, lengths = np.empty(steps), np.empty(steps)
    count = 0
    for beam in range(len(beams.elevations)):
        line, azimuths, first = _line_of(rays, beam, region.lift), along(beams, beam), beam * steps
        cosines, sines = azimuths
        distances, target = ranges[first : first + steps], targets[first : first + steps]
        light, of_beam = reflected[first : first + steps], (distances, target)
        of_rays = _poses_along(poses, beams, beam)
        _mark_within(line, azimuths, of_beam, region, chance.noise, of_rays, inside)
        number = 0
        for n in range(steps):
            kept_steps[number] = n
            number += inside[n]
        if chance.corrected or chance.drop_off > 0.0:
            number = _drop_lost(beams, first, of_beam, (chance, stream), kept_steps[:number])
        if chance.noise > 0.0:
            noise, first_ray = chance.noise, chance.first_ray + first
            for i in range(number):
                ray = first_ray + kept_steps[i]
                errors[i] = uniform(stream, np.uint64(2 * ray + 1))
            _fill_normals(errors, number, flank)
            for i in range(number):
                errors[i] = max(noise * errors[i], -distances[kept_steps[i]])
        else:
            errors[:number] = 0.0
        start = count
        for i in range(number):
            n = kept_steps[i]
            length, bright = distances[n] + errors[i], light[n]
            cosine, sine = cosines[n], sines[n]
            px = line.start[0] + length * _toward(line.x, cosine, sine)
            py = line.start[1] + length * _toward(line.y, cosine, sine)
            px, py = _moved(px, py, of_rays, n)
            rise = _toward(line.z, cosine, sine)
            flat = target[n] == region.flat
            pz = region.lift + errors[i] * rise if flat else line.start[2] + length * rise
            if target[n] == GROUND:
                bright *= _reflectivity_at(ground, px, py)
            points[count, 0], points[count, 1], points[count, 2] = px, py, pz
            points[count, 3], lengths[count - start] = bright, length
            within = _is_within(px, py, pz, region.crop, 0.0)
            count += within & returns_light(distances[n], bright, beams)
        for i in range(count - start):
            bright = dimming[1] * points[start + i, 3] * math.exp(-dimming[0] * lengths[i])
            points[start + i, 3] = min(bright, 1.0)
    return count


@inlined
def _mark_within(line, azimuths, hits, region, noise, poses, inside):
    """Mark the steps of a beam whose hits return light and are in a region, up to their errors."""
    (cosines, sines), (ranges, targets), slack = azimuths, hits, LARGEST_ERROR * noise
    for n in range(len(inside)):
        px = line.start[0] + ranges[n] * _toward(line.x, cosines[n], sines[n])
        py = line.start[1] + ranges[n] * _toward(line.y, cosines[n], sines[n])
        px, py = _moved(px, py, poses, n)
        pz = line.start[2] + ranges[n] * _toward(line.z, cosines[n], sines[n])
        # Rounding must not push the ground out of a crop that starts at z = 0.
        pz = region.lift if targets[n] == region.flat else pz
        inside[n] = _is_within(px, py, pz, region.crop, slack) & (targets[n] >= WORLD)


@inlined
def _drop_lost(beams, first, hits, chances, steps):
    """Keep the steps whose returns are not lost, at the front of `steps`; return their number."""
    (chance, stream), (ranges, targets), factors = chances, hits, chances[0].factors
    number = 0
    for i in range(len(steps)):
        n = steps[i]
        steps[number] = n
        lost, factor, distance = chance.drop_off, 1.0, 0.0
        if chance.corrected:
            if 0 <= targets[n] < len(factors):
                factor, distance = factors[targets[n]], ranges[n]
            lost = lost_share(first + n, distance, factor, chance.drop_off, beams)
        number += uniform(stream, np.uint64(2 * (chance.first_ray + first + n))) > lost
    return number


@inlined
def _reflectivity_at(ground, x, y):
    """Return the reflectivity of the ground at a place of the ego frame."""
    cells = ground.reflectivity
    u = ground.x + ground.c * x - ground.s * y
    v = ground.y + ground.s * x + ground.c * y
    row, column = np.int64(math.floor(v)), np.int64(math.floor(u))
    return cells[row & (cells.shape[0] - 1), column & (cells.shape[1] - 1)]
