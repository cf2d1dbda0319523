"""Exact traversal of single rays through the voxels (after Amanatides and Woo, 1987).

A ray passes a voxel when the half-open cube holds a point `origin + t * direction` with 0 < t <
reach. So where it goes through an edge or a corner, neighbours that it only touches are passed
over: of the steps due at one t those along growing coordinates come first, all at once."""

import math

import numpy as np

from lidarplace.base.kernel_cache import inner


@inner
def _crossing(cell, origin, d, minimum, resolution):
    """Return the ray parameter at which a ray leaves `cell` along one axis.

    It is computed from the grid line, not by adding up: errors do not grow along the ray, and equal
    parameters of two axes compare equal where coordinates and directions have few bits."""
    if d == 0.0:
        return math.inf
    return (minimum + (cell + (d > 0)) * resolution - origin) / d


@inner
def _first_cell(start, origin, d, minimum, resolution, cells):
    """Return the cell on one axis just before the ray enters the grid, or just after its start.

    Before the grid it is -1 or `cells`."""
    position = math.floor((origin + start * d - minimum) / resolution)
    cell = int(min(max(position, -1), cells))
    if d > 0:
        while cell >= 0 and not _is_past(cell, start, origin, d, minimum, resolution):
            cell -= 1
        while cell < cells and _is_past(cell + 1, start, origin, d, minimum, resolution):
            cell += 1
    elif d < 0:
        while cell < cells and not _is_past(cell + 1, start, origin, d, minimum, resolution):
            cell += 1
        while cell >= 0 and _is_past(cell, start, origin, d, minimum, resolution):
            cell -= 1
    return cell


@inner
def _is_past(line, start, origin, d, minimum, resolution):
    """Return whether a grid line is crossed before the ray enters the grid, or where it starts."""
    crossing = (minimum + line * resolution - origin) / d
    return crossing < start or crossing <= 0.0


@inner
def walk_dda(origin, direction, start, reach, grid, voxels, size):
    """Append the voxels of one ray to the first `size` of `voxels`; returns the new size."""
    minimum, resolution, shape, strides = grid
    ox, oy, oz = origin[0], origin[1], origin[2]
    dx, dy, dz = direction[0], direction[1], direction[2]
    x0, y0, z0 = minimum[0], minimum[1], minimum[2]
    nx, ny, nz = shape[0], shape[1], shape[2]
    i = _first_cell(start, ox, dx, x0, resolution, nx)
    j = _first_cell(start, oy, dy, y0, resolution, ny)
    k = _first_cell(start, oz, dz, z0, resolution, nz)
    tx = _crossing(i, ox, dx, x0, resolution)
    ty = _crossing(j, oy, dy, y0, resolution)
    tz = _crossing(k, oz, dz, z0, resolution)
    up_x, up_y, up_z = dx > 0, dy > 0, dz > 0
    step_x, step_y, step_z = (1 if up_x else -1), (1 if up_y else -1), (1 if up_z else -1)
    end_x, end_y, end_z = (nx if up_x else -1), (ny if up_y else -1), (nz if up_z else -1)
    jump_x, jump_y, jump_z = step_x * strides[0], step_y * strides[1], step_z * strides[2]
    index = i * strides[0] + j * strides[1] + k * strides[2]
    one = np.uint64(1)
    if start == 0.0:
        voxels[size] = index
        size += one
    while True:
        if tx < ty and tx < tz:
            i += step_x
            if tx >= reach or i == end_x:
                return size
            index += jump_x
            tx = _crossing(i, ox, dx, x0, resolution)
        elif ty < tx and ty < tz:
            j += step_y
            if ty >= reach or j == end_y:
                return size
            index += jump_y
            ty = _crossing(j, oy, dy, y0, resolution)
        elif tz < tx and tz < ty:
            k += step_z
            if tz >= reach or k == end_z:
                return size
            index += jump_z
            tz = _crossing(k, oz, dz, z0, resolution)
        else:  # through an edge or a corner
            t = min(tx, ty, tz)
            if t >= reach:
                return size
            at_x, at_y, at_z = tx == t, ty == t, tz == t
            grows = (at_x and up_x) or (at_y and up_y) or (at_z and up_z)
            falls = (at_x and not up_x) or (at_y and not up_y) or (at_z and not up_z)
            for up in (True, False):
                if at_x and up_x == up:
                    i += step_x
                    index += jump_x
                    tx = _crossing(i, ox, dx, x0, resolution)
                if at_y and up_y == up:
                    j += step_y
                    index += jump_y
                    ty = _crossing(j, oy, dy, y0, resolution)
                if at_z and up_z == up:
                    k += step_z
                    index += jump_z
                    tz = _crossing(k, oz, dz, z0, resolution)
                if i == end_x or j == end_y or k == end_z:
                    return size
                inside = 0 <= i < nx and 0 <= j < ny and 0 <= k < nz
                if up and grows and falls and inside:
                    voxels[size] = index
                    size += one
        voxels[size] = index
        size += one
