"""Casting of the rays of LiDARs, and what returns of them, a program for a run of rays.

The twin of `cast_compiled`, `_scatter` and `_sample` of `lidarplace.clouds`, in float64 and with
their random numbers; the order of products and sums is theirs.
"""

import math

import torch
import triton
import triton.language as tl
from torch import Tensor

from lidarplace.clouds.droplets import DROPS
from lidarplace.clouds.raycast import GROUND, HAIR, NOTHING
from lidarplace.clouds.seen_parts import SEEN_COLUMNS
from lidarplace.clouds.shapes import BODY, WORLD
from training.ops.gpu.launch import launch

_RAYS = 256
NUMBERS = 38
"""Of a view: 3 of its origin, 9 of its rotation, height over the ground or NaN, least inverse
distance, `nearest`, `sight_10`, `falloff`, `fading` and `loss` of `Beams`, lift, range noise,
drop-off, two numbers of dimming, extinction, range and light of drops, 4 numbers of the frame in
the cells of the ground, 6 of the crop, and the step of the grid."""
INTEGERS = 16
"""Of a view: first program, rays, steps of a beam, 1 if each beam has an azimuth of its own, first
rows of elevations and azimuths, first and past the last row of `seen`, first of `ends` or -1, first
of `masks` or -1, first of `factors` and their number, stream of random numbers, rays of the LiDAR
before these, rays of the whole LiDAR, first row of points."""


def cast_rays(
    programs: Tensor, views: tuple[Tensor, Tensor], tables: tuple[Tensor, ...], rays: int
) -> tuple[Tensor, Tensor]:
    """Cast all rays of the views; return points (rays, 4) float32, and which return, (rays,) bool.

    Args:
        programs: view of every program, (P,) int32, see `programs_of`.
        views: numbers (V, NUMBERS) float64 and integers (V, INTEGERS) int64.
        tables: elevations and azimuths with cosine and sine, (n, 3) float64; `seen` of
            `fill_seen`; ends, masks, factors, float64, at least one of each; reflectivity of the
            ground, (256, 256) float32.
        rays: of all views."""
    numbers, integers = views
    points = torch.empty(rays, 4, dtype=torch.float32, device=programs.device)
    returned = torch.empty(rays, dtype=torch.bool, device=programs.device)
    arguments = (programs, numbers, integers, *tables, points, returned)
    launch(_cast_kernel, len(programs), *arguments, RAYS=_RAYS)
    return points, returned


def programs_of(rays: Tensor) -> tuple[Tensor, Tensor]:
    """Return the view of every program, int32, and the first program of every view, int64."""
    counts = (rays + _RAYS - 1) // _RAYS
    views = torch.arange(len(rays), dtype=torch.int32).repeat_interleave(counts)
    return views, counts.cumsum(0) - counts


_GROUND, _NOTHING, _BODY, _WORLD = map(tl.constexpr, (GROUND, NOTHING, BODY, WORLD))
_DROPS, _SEEN = tl.constexpr(DROPS), tl.constexpr(SEEN_COLUMNS)
_NUMBERS, _INTEGERS = tl.constexpr(NUMBERS), tl.constexpr(INTEGERS)
_TURN, _HAIR = tl.constexpr(2 * math.pi), tl.constexpr(HAIR)


@triton.jit
def _cast_kernel(
    programs, numbers, integers, elevations, azimuths, seen, ends, masks, factors, ground,
    points, returned, RAYS: tl.constexpr,
):  # fmt: skip
    program = tl.program_id(0)
    view = tl.load(programs + program).to(tl.int64)
    numbers += view * _NUMBERS
    integers += view * _INTEGERS
    rays = tl.load(integers + 1)
    lane = (program - tl.load(integers)) * RAYS + tl.arange(0, RAYS)
    inside = lane < rays
    ray = tl.minimum(lane, rays - 1)
    steps = tl.load(integers + 2)
    beam = ray // steps
    elevations += 3 * (tl.load(integers + 4) + beam)
    azimuths += 3 * (tl.load(integers + 5) + ray - beam * steps + beam * tl.load(integers + 3))
    ce, se = tl.load(elevations + 1), tl.load(elevations + 2)
    cosine, sine = tl.load(azimuths + 1), tl.load(azimuths + 2)

    # The ground, the end at the rig, or nothing within reach.
    high = tl.load(numbers + 12)
    a = -tl.load(numbers + 9) * ce / high
    b = -tl.load(numbers + 10) * ce / high
    inverse = a * cosine + b * sine + -tl.load(numbers + 11) * se / high
    farthest = tl.load(numbers + 13)
    hit = tl.where(inverse > farthest, _GROUND, _NOTHING).to(tl.int64)
    inverse = tl.where(inverse > farthest, inverse, farthest)
    first = tl.load(integers + 8)
    end = tl.load(ends + first + ray, (ray >= 0) & (first >= 0), 0.0)
    hit = tl.where(end > inverse, _BODY, hit)
    inverse = tl.where(end > inverse, end, inverse)

    # Parts whose window overlaps that of the rays.
    elevation, azimuth = tl.load(elevations), tl.load(azimuths)
    lowest, highest = tl.min(elevation, 0), tl.max(elevation, 0)
    middle = tl.min(azimuth, 0)
    width = tl.max(_turn(azimuth - middle), 0)
    for row in range(tl.load(integers + 6), tl.load(integers + 7)):
        part = seen + row * _SEEN
        away = _turn(tl.load(part + 30) - middle)
        near = away <= tl.load(part + 31) + width + _HAIR
        if near & (tl.load(part + 32) <= highest) & (tl.load(part + 33) >= lowest):
            enter = _enter(part, ce, se, cosine, sine)
            hit = tl.where(enter > inverse, row, hit)
            inverse = tl.where(enter > inverse, enter, inverse)

    distance = tl.where(hit == _NOTHING, float("inf"), 1.0 / inverse)
    light = tl.where(hit == _GROUND, tl.minimum(inverse * high, 1.0), 0.0)
    part = seen + tl.maximum(hit, 0) * _SEEN
    met = hit >= 0
    cosine_of_part = _cosine(part, met, ce, se, cosine, sine)
    shade = tl.minimum(cosine_of_part, 1.0) * tl.load(part + 36, met, 0.0)
    light = tl.where(met, shade, light)
    target = tl.where(met, tl.load(part + 35, met, 0.0).to(tl.int64), hit)

    stream = tl.load(integers + 12).to(tl.uint64, bitcast=True)
    number = tl.load(integers + 13) + ray
    extinction = tl.load(numbers + 24)
    if extinction > 0.0:
        drop = _uniform(stream, 2 * tl.load(integers + 14) + number)
        drop = tl.load(numbers + 14) - tl.log(drop) / extinction
        falls = (drop < tl.load(numbers + 25)) & (drop < distance)
        distance = tl.where(falls, drop, distance)
        light = tl.where(falls, tl.load(numbers + 26), light)
        target = tl.where(falls, _DROPS, target)

    # Losses and errors of the range.
    first = tl.load(integers + 10)
    known = (target >= 0) & (target < tl.load(integers + 11))
    share = tl.load(factors + first + tl.maximum(target, 0), known, 1.0)
    share *= tl.exp(-tl.load(numbers + 18) * tl.where(known, distance, 0.0))
    first = tl.load(integers + 9)
    share *= tl.load(masks + first + ray, (ray >= 0) & (first >= 0), 1.0)
    drop_off = tl.load(numbers + 21)
    lost = drop_off + (1.0 - tl.minimum(share, 1.0)) * (1.0 - drop_off)
    remains = (target >= _WORLD) & (_uniform(stream, 2 * number) > lost)
    error = tl.load(numbers + 20) * _normal(_uniform(stream, 2 * number + 1))
    error = tl.maximum(error, -distance)

    # Points.
    lift, length = tl.load(numbers + 19), distance + error
    dx = _toward(numbers + 3, ce, se, cosine, sine)
    dy = _toward(numbers + 6, ce, se, cosine, sine)
    dz = _toward(numbers + 9, ce, se, cosine, sine)
    x = tl.load(numbers) + length * dx
    y = tl.load(numbers + 1) + length * dy
    z = tl.load(numbers + 2) + lift + length * dz
    z = tl.where(target == _GROUND, lift + error * dz, z)
    light *= tl.where(target == _GROUND, _reflectivity(ground, numbers + 27, x, y, remains), 1.0)
    crop = numbers + 31
    remains &= (x >= tl.load(crop)) & (x <= tl.load(crop + 3))
    remains &= (y >= tl.load(crop + 1)) & (y <= tl.load(crop + 4))
    remains &= (z >= tl.load(crop + 2)) & (z <= tl.load(crop + 5))
    remains &= _returns_light(distance, light, numbers + 14)
    dimmed = tl.load(numbers + 23) * light.to(tl.float32).to(tl.float64)
    bright = tl.minimum(dimmed * tl.exp(-tl.load(numbers + 22) * length), 1.0)
    row = tl.load(integers + 15) + ray
    _store_rounded(points + 4 * row, x, numbers, 0, inside & remains)
    _store_rounded(points + 4 * row, y, numbers, 1, inside & remains)
    _store_rounded(points + 4 * row, z, numbers, 2, inside & remains)
    bright = tl.floor(255 * bright.to(tl.float32).to(tl.float64) + 0.5) / 255
    tl.store(points + 4 * row + 3, bright.to(tl.float32), inside & remains)
    tl.store(returned + row, remains, inside)


@triton.jit
def _turn(angle):
    """Size of the shortest turn by an angle."""
    return tl.abs(angle - _TURN * tl.floor(angle / _TURN + 0.5))


@triton.jit
def _enter(part, ce, se, cosine, sine):
    """Inverse distances at which rays enter a part, negative for those that miss it."""
    facing = tl.load(part + 34)
    enter = tl.full(ce.shape, float("inf"), tl.float64)
    for k in tl.static_range(6):
        a, b = ce * tl.load(part + 5 * k), ce * tl.load(part + 5 * k + 1)
        c = se * tl.load(part + 5 * k + 2) + tl.load(part + 5 * k + 3)
        inverse = a * cosine + b * sine + c
        leave = tl.where(enter >= inverse, enter, -1.0)
        enter = tl.where(facing > k, tl.minimum(enter, inverse), leave)
    return enter


@triton.jit
def _cosine(part, met, ce, se, cosine, sine):
    """Cosine of incidence of each ray on the part that it meets."""
    facing = tl.load(part + 34, met, 0.0)
    least = tl.full(ce.shape, float("inf"), tl.float64)
    result = tl.zeros(ce.shape, tl.float64)
    for k in tl.static_range(6):
        a = ce * tl.load(part + 5 * k, met, 0.0)
        b = ce * tl.load(part + 5 * k + 1, met, 0.0)
        c = se * tl.load(part + 5 * k + 2, met, 0.0) + tl.load(part + 5 * k + 3, met, 0.0)
        inverse = a * cosine + b * sine + c
        nearer = (facing > k) & (inverse < least)
        result = tl.where(nearer, inverse * tl.load(part + 5 * k + 4, met, 0.0), result)
        least = tl.where(nearer, inverse, least)
    return result


@triton.jit
def _toward(axis, ce, se, cosine, sine):
    """Coordinate of the directions along an axis, a row of the rotation."""
    a, b, c = ce * tl.load(axis), ce * tl.load(axis + 1), se * tl.load(axis + 2)
    return a * cosine + b * sine + c


@triton.jit
def _mix(state):
    z = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB
    return z ^ (z >> 31)


@triton.jit
def _uniform(stream, counter):
    """Numbers of a stream, see `lidarplace.clouds.hashed.uniform`."""
    bits = _mix(stream + (counter + 1).to(tl.uint64) * 0x9E3779B97F4A7C15)
    return ((bits >> 12).to(tl.int64).to(tl.float64) + 0.5) * 2.220446049250313e-16


@triton.jit
def _normal(uniform):
    """Standard normals of uniform numbers, see `lidarplace.clouds.returns._fill_normals`."""
    q = uniform - 0.5
    r = 0.180625 - q * q
    centre = ((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179
    centre /= ((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1.0
    r = tl.sqrt(-tl.log(tl.minimum(uniform, 1.0 - uniform)))
    s = r - 1.6
    flank = ((0.17023821103 * s + 1.3067284816) * s + 2.7568153900) * s + 1.4234372777
    flank /= (0.12021132975 * s + 0.73700164250) * s + 1.0
    s = r - 5.0
    tail = ((0.017337203997 * s + 0.42868294337) * s + 3.0812263860) * s + 6.6579051150
    tail /= (0.012258202635 * s + 0.24197894225) * s + 1.0
    outside = tl.where(r <= 5.0, flank, tail) + 2.0 - 2.0  # as rounded there
    return tl.where(tl.abs(q) <= 0.425, q * centre, tl.where(q < 0.0, -outside, outside))


@triton.jit
def _reflectivity(ground, frame, x, y, mask):
    """Reflectivity of the ground at places of the ego frame."""
    c, s = tl.load(frame + 2), tl.load(frame + 3)
    u = tl.load(frame) + c * x - s * y
    v = tl.load(frame + 1) + s * x + c * y
    column = tl.floor(tl.where(mask, u, 0.0)).to(tl.int64) & 255
    row = tl.floor(tl.where(mask, v, 0.0)).to(tl.int64) & 255
    return tl.load(ground + row * 256 + column).to(tl.float64)


@triton.jit
def _returns_light(distance, light, limits):
    """Test if surfaces are neither too near nor too dark to be seen."""
    farthest = tl.load(limits + 1) * tl.exp(tl.load(limits + 2) * tl.log(10.0 * light))
    dimmed = distance * tl.exp(tl.load(limits + 3) * distance)
    # NaN: of no light in endless sight.
    return ((farthest != farthest) | (dimmed <= farthest)) & (distance >= tl.load(limits))


@triton.jit
def _store_rounded(points, value, numbers, axis: tl.constexpr, mask):
    """Store coordinates on the grid, see `lidarplace.clouds.clouds.as_kept`."""
    low, step = tl.load(numbers + 31 + axis), tl.load(numbers + 37)
    place = tl.floor((value.to(tl.float32).to(tl.float64) - low) / step + 0.5)
    tl.store(points + axis, (low + step * place).to(tl.float32), mask)
