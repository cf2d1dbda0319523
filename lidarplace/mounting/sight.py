"""Obstacles of a vehicle and its rig in the way of a ray."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.mounting.housing import behind_housing
from lidarplace.mounting.mesh import NO_TREE, Tree, depths, first_hit
from lidarplace.mounting.vehicle import Vehicle


class Obstacles(NamedTuple):
    """Obstacles that stop rays, as compiled code takes them.

    Attributes:
        boxes: lower and upper corners, metres, shape (n, 2, 3).
        housings: rows of `lidarplace.mounting.housing`.
        mesh: the tree over a mesh."""

    boxes: NDArray[np.float64]
    housings: NDArray[np.float64]
    mesh: Tree


def obstacles_of(
    vehicle: Vehicle, housings: NDArray[np.float64], place: NDArray[np.float64] | None = None
) -> Obstacles:
    """Return the body of a vehicle, and LiDARs on it, as obstacles.

    Parts of the body that `place` (3,) is inside of hide nothing: a sensor is there, behind a
    window or a bumper."""
    boxes, mesh = vehicle.interior, NO_TREE if vehicle.mesh is None else vehicle.mesh.tree
    if place is not None:
        boxes = boxes[~((boxes[:, 0] < place) & (place < boxes[:, 1])).all(axis=1)]
        if vehicle.mesh is not None and depths(vehicle.mesh, place[None])[0] > 0:
            mesh = NO_TREE
    return Obstacles(boxes, housings, mesh)


@njit(cache=True, nogil=True, error_model="numpy")
def stopped(origin, dx, dy, dz, reach, obstacles: Obstacles, lidar):
    """Return whether a ray origin + t (dx, dy, dz) is inside an obstacle for some t in (0, reach).

    A touch of a box's face does not count; a surface of triangles is met. `lidar`: number of the
    LiDAR whose housing does not count."""
    for box in obstacles.boxes:
        near, far = 0.0, reach
        for axis, d in enumerate((dx, dy, dz)):
            low, high = box[0, axis] - origin[axis], box[1, axis] - origin[axis]
            if d == 0.0:
                if low >= 0.0 or high <= 0.0:
                    far = -1.0
            else:
                t0, t1 = low / d, high / d
                near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
        if near < far:
            return True
    if behind_housing(origin, dx, dy, dz, reach, obstacles.housings, lidar):
        return True
    return first_hit(origin, dx, dy, dz, reach, obstacles.mesh) < reach
