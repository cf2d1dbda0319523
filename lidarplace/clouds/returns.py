"""From hits to points: drop-off, range noise, intensity and the cut to a region.

Random numbers are hashes of seed, frame, LiDAR and ray. So a point does not depend on which frames
are collected with it, in which order or by how many workers."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
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


def sample_points(
    mount: Mount,
    lidar: Lidar,
    hits: Hits,
    ground: Ground,
    crop: Sequence[float],
    key: tuple[int, int, int],
    points: NDArray[np.float32],
    lift: float = 0.0,
    classes: Sequence[str] = (),
    level: bool = True,
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
    frame, metres, its faces included. `key` (seed, frame, index of the LiDAR) decides drop-off and
    noise together with the ray. x, y, z and intensity go to the first rows of `points`, float32,
    (rays or more, 4), in the order of the rays; z is raised by `lift`, metres, before the cut.
    `classes` are those of objects by the number that `hits` have of them, for a correction: what
    has another number is no object to it. `level`: whether the ground is flat, at z = 0."""
    count, region = 0, np.array(crop, np.float64)
    codes = WORLD, GROUND, GROUND if level else NOTHING
    dimmed = ATTENUATION_PER_M + 2.0 * lidar.extinction, lidar.window**2
    x, y, yaw = ground.pose
    # Origin of the ego frame in cells of the ground, and its x axis in cells a metre.
    axis = x / CELL_M, y / CELL_M, math.cos(yaw) / CELL_M, math.sin(yaw) / CELL_M
    corrected, factors = lidar.correction is not None, np.empty(0)
    if lidar.correction is not None:
        factors = lidar.correction.factors_of(classes)
    noise = float(lidar.range_noise)
    for rays, numbers in rays_of(mount, lidar):
        chance = noise, lidar.drop_off, key_of(*key), numbers.start, corrected, factors
        where = region, lift, hits.of(numbers), codes, (ground.reflectivity, *axis)
        count += _sample(*rays, *where, chance, dimmed, points[count:])
    return count


# Coefficients of the normal quantile, from the constant term on (Wichura 1988, AS 241, PPND7).
_CENTRE = (3.3871327179, 50.434271938, 159.29113202, 59.109374720)
_CENTRE_BELOW = (1.0, 17.895169469, 78.757757664, 67.187563600)
_FLANK = (1.4234372777, 2.7568153900, 1.3067284816, 0.17023821103)
_FLANK_BELOW = (1.0, 0.73700164250, 0.12021132975, 0.0)
_TAIL = (6.6579051150, 3.0812263860, 0.42868294337, 0.017337203997)
_TAIL_BELOW = (1.0, 0.24197894225, 0.012258202635, 0.0)


@inner
def _ratio(above, below, r):
    """Quotient of two cubic polynomials."""
    top = ((above[3] * r + above[2]) * r + above[1]) * r + above[0]
    return top / (((below[3] * r + below[2]) * r + below[1]) * r + below[0])


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


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(
    origin, rotation, beams, crop, lift, hits, codes, ground_cells, chance, dimmed, points
) -> int:
    """Write the returns within `crop` to `points` and return their number: beam by beam, in short
    loops over arrays without branches."""
    faintest, ground, flat = codes  # what is flat is at z = 0
    elevations = beams.elevations
    ranges, targets, reflected = hits
    cells, cell_x, cell_y, cell_c, cell_s = ground_cells
    range_noise, drop_off, key, start_ray, corrected, factors = chance
    slack = LARGEST_ERROR * range_noise
    last_row, last_column = cells.shape[0] - 1, cells.shape[1] - 1
    stream = stream_of(key)
    attenuation, window = dimmed
    steps = beams.azimuths.shape[2]
    # Not read again from arrays within the loops, which write to others.
    left, right, near, far = crop[0], crop[3], crop[1], crop[4]
    floor, roof = crop[2], crop[5]
    start_x, start_y = origin[0], origin[1]
    bottom = origin[2] + lift
    inside = np.empty(steps, np.bool_)
    # Unsigned indices: numba need not ask whether they count from the end.
    steps_kept, flank = np.empty(steps, np.uint32), np.empty(steps, np.uint32)
    errors = np.empty(steps)
    count = 0
    for beam in range(len(elevations)):
        ce, se = elevations[beam, 1], elevations[beam, 2]
        cosines, sines = along(beams, beam)
        ax, bx, cx = ce * rotation[0, 0], ce * rotation[0, 1], se * rotation[0, 2]
        ay, by, cy = ce * rotation[1, 0], ce * rotation[1, 1], se * rotation[1, 2]
        az, bz, cz = ce * rotation[2, 0], ce * rotation[2, 1], se * rotation[2, 2]
        first = beam * steps
        distance, target = ranges[first : first + steps], targets[first : first + steps]
        light = reflected[first : first + steps]
        for n in range(steps):
            px = start_x + distance[n] * (ax * cosines[n] + bx * sines[n] + cx)
            py = start_y + distance[n] * (ay * cosines[n] + by * sines[n] + cy)
            pz = bottom + distance[n] * (az * cosines[n] + bz * sines[n] + cz)
            # Rounding must not push the ground out of a crop that starts at z = 0.
            pz = lift if target[n] == flat else pz
            within = (px >= left - slack) & (px <= right + slack) & (py >= near - slack)
            within &= (py <= far + slack) & (pz >= floor - slack) & (pz <= roof + slack)
            inside[n] = within & (target[n] >= faintest)
        kept = 0
        for n in range(steps):
            steps_kept[kept] = n
            kept += inside[n]
        if corrected or drop_off > 0.0:
            candidates, kept = kept, 0
            for i in range(candidates):
                n = steps_kept[i]
                steps_kept[kept] = n
                lost, factor, away = drop_off, 1.0, 0.0
                if corrected:
                    if 0 <= target[n] < len(factors):
                        factor, away = factors[target[n]], distance[n]
                    lost = lost_share(first + n, away, factor, drop_off, beams)
                kept += uniform(stream, np.uint64(2 * (start_ray + first + n))) > lost
        if range_noise > 0.0:
            for i in range(kept):
                ray = start_ray + first + steps_kept[i]
                errors[i] = uniform(stream, np.uint64(2 * ray + 1))
            _fill_normals(errors, kept, flank)
        start = count
        for i in range(kept):
            n = steps_kept[i]
            error = max(range_noise * errors[i], -distance[n]) if range_noise > 0.0 else 0.0
            length = distance[n] + error
            px = start_x + length * (ax * cosines[n] + bx * sines[n] + cx)
            py = start_y + length * (ay * cosines[n] + by * sines[n] + cy)
            dz = az * cosines[n] + bz * sines[n] + cz
            pz = lift + error * dz if target[n] == flat else bottom + length * dz
            points[count, 0], points[count, 1], points[count, 2] = px, py, pz
            bright = light[n]
            if target[n] == ground:
                u = cell_x + cell_c * px - cell_s * py
                v = cell_y + cell_s * px + cell_c * py
                row, column = np.int64(math.floor(v)), np.int64(math.floor(u))
                bright *= cells[row & last_row, column & last_column]
            points[count, 3] = bright
            errors[count - start] = length
            within = (px >= left) & (px <= right) & (py >= near) & (py <= far)
            within &= (pz >= floor) & (pz <= roof)
            count += within & returns_light(distance[n], bright, beams)
        for i in range(count - start):
            bright = window * points[start + i, 3] * math.exp(-attenuation * errors[i])
            points[start + i, 3] = min(bright, 1.0)
    return count
