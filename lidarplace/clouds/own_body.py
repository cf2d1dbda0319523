"""The body of the vehicle that carries the LiDARs, as its clouds have it.

A vehicle that nobody describes is a sedan of convex parts; `Vehicle.car()` is somewhat larger."""

from functools import cache
from inspect import unwrap

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import point
from lidarplace.clouds.convex import fill_corners
from lidarplace.clouds.shapes import BODY, Parts, between, bricks, own_body
from lidarplace.mounting.limits import Limits, MountedSensors, check
from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.trailer import FACES, BendingVehicle
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement

_SEDAN = own_body()


def body_parts(vehicle: Vehicle | None) -> Parts:
    """Return the convex parts of the body, without light; those of a sedan for None."""
    return _SEDAN if vehicle is None else bricks(between(vehicle.boxes), BODY, 0.0)


@cache
def sedan() -> Vehicle:
    """Return the sedan as a surface."""
    corners = np.empty((len(_SEDAN), 8, 3))
    for part, part_corners in zip(_SEDAN.geometry, corners, strict=True):
        unwrap(fill_corners)(part, part_corners)
    faces = (8 * np.arange(len(corners))[:, None, None] + FACES).reshape(-1, 3)
    return Vehicle("sedan", np.empty((0, 2, 3)), Mesh(corners.reshape(-1, 3), faces))


def check_mounts(rig: Placement, vehicle: Vehicle | None) -> None:
    """Raise ValueError if a LiDAR of the rig is inside of the body of its vehicle."""
    body = sedan() if vehicle is None else vehicle
    for inside in check(MountedSensors(rig.mounts, rig.lidars), Limits(body=body), body):
        (number,) = inside.lidars
        region = "body, which the key vehicle describes"
        if isinstance(body.body, BendingVehicle):
            region = "body, or on or in the way of its trailer; expected a place on the tractor"
        place = point(*rig.mounts[number].position)
        wrong = f"LiDAR {number + 1} at {place} is inside the vehicle's {region}"
        raise InputError(wrong, place=repr(rig.name))
