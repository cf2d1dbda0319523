"""Bodies of vehicles that carry LiDARs: boxes, a mesh, or both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError, at
from lidarplace.base.roi import Interval, Roi
from lidarplace.mounting.mesh import Mesh, depths
from lidarplace.mounting.zone import Zone, position

_HAIR = 1e-9  # a sensor mounted on a face is outside, and a ray along a face passes


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A body that stops rays.

    Attributes:
        name: for messages.
        boxes: lower and upper corners in the ego frame, metres, shape (n, 2, 3); n may be 0. A box
            without volume stops no ray. Between boxes that only touch rays pass along the common
            face: let boxes overlap.
        mesh: a surface that stops rays from both sides; None: none.

    Raises:
        ValueError: another shape, a coordinate that is not finite, or a lower corner above the
            upper one."""

    name: str
    boxes: NDArray[np.float64]
    mesh: Mesh | None = None
    interior_name = "the vehicle"

    def __post_init__(self) -> None:
        boxes = np.array(self.boxes, np.float64)
        if boxes.size == 0:
            boxes = np.empty((0, 2, 3))
        with at(f"vehicle {self.name!r}"):
            if boxes.ndim != 3 or boxes.shape[1:] != (2, 3):
                corners = "a lower and an upper corner (x, y, z) of each, shape (n, 2, 3)"
                raise InputError(key="boxes", expected=corners, found=f"shape {boxes.shape}")
            finite = np.isfinite(boxes).all(axis=(1, 2))
            for n in np.flatnonzero(~(finite & (boxes[:, 0] <= boxes[:, 1]).all(axis=1))):
                corners = "finite corners, the lower one first"
                raise InputError(key=f"boxes[{n}]", expected=corners, found=boxes[n].tolist())
        object.__setattr__(self, "boxes", boxes)

    @classmethod
    def car(cls) -> Vehicle:
        """A middle-class car, 4.7 m by 1.9 m by 1.5 m: hull and cabin, both down to the ground."""
        hull = [[-2.35, -0.95, 0.0], [2.35, 0.95, 0.95]]
        cabin = [[-1.75, -0.8, 0.0], [0.9, 0.8, 1.5]]
        return cls("car", np.array([hull, cabin]))

    def with_boxes(self, boxes: NDArray[np.float64]) -> Vehicle:
        """Return the vehicle with further boxes, shape (n, 2, 3)."""
        return replace(self, boxes=np.concatenate([self.boxes, boxes]))

    @property
    def body(self) -> Vehicle:
        """The vehicle without keep-outs."""
        return self

    @property
    def poses(self) -> Mapping[str, Vehicle]:
        """The vehicle in all of its shapes, by the name of the case; "": as it is, as in clouds."""
        return {"": self}

    @property
    def no_mounts(self) -> NDArray[np.float64]:
        """The boxes in which no LiDAR may sit, shape (m, 2, 3)."""
        return self.interior

    @property
    def extents(self) -> NDArray[np.float64]:
        """The boxes, and the one around the mesh, shape (n, 2, 3)."""
        if self.mesh is None:
            return self.boxes
        around = [self.mesh.triangles.min(axis=(0, 1)), self.mesh.triangles.max(axis=(0, 1))]
        return np.concatenate([self.boxes, [around]])

    @property
    def height(self) -> float:
        """Height of the highest top above the ground, metres; 0 without a body."""
        return float(self.extents[:, 1, 2].max(initial=0.0))

    @property
    def interior(self) -> NDArray[np.float64]:
        """The boxes with volume, their faces moved inwards by a nanometre; shape (m, 2, 3)."""
        shrunk = self.boxes + np.array([[_HAIR], [-_HAIR]])
        return np.asarray(shrunk[(shrunk[:, 0] < shrunk[:, 1]).all(axis=1)])

    def in_mesh(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which of places (P, 3) the surface goes around."""
        return (
            np.zeros(len(places), np.bool_) if self.mesh is None else depths(self.mesh, places) > 0
        )


@dataclass(frozen=True, eq=False)
class EquippedVehicle(Vehicle):
    """A vehicle with keep-outs, the last of its boxes: they hide objects and contain no LiDAR.

    Areas are measured from its `body`, which is `bare` of them, so that keep-outs move no area."""

    bare: Vehicle = field(kw_only=True)

    @property
    def body(self) -> Vehicle:
        """The vehicle without keep-outs."""
        return self.bare

    @cached_property
    def poses(self) -> Mapping[str, Vehicle]:
        """Shapes of the body, each with the keep-outs, by the name of the case."""
        keep_outs = self.boxes[len(self.bare.boxes) :]
        return {label: pose.with_boxes(keep_outs) for label, pose in self.bare.poses.items()}

    @property
    def no_mounts(self) -> NDArray[np.float64]:
        """The boxes in which no LiDAR may sit."""
        return np.concatenate([self.bare.no_mounts, self.interior])


def with_keep_outs(vehicle: Vehicle, boxes: NDArray[np.float64]) -> Vehicle:
    """Return the vehicle with keep-outs, shape (n, 2, 3), metres."""
    if not len(boxes):
        return vehicle
    every = np.concatenate([vehicle.boxes, boxes])
    return EquippedVehicle(vehicle.name, every, vehicle.mesh, bare=vehicle)


def depth_in_body(vehicle: Vehicle, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each of places (P, 3) is inside of the body in any of its poses, metres.

    Shape (P,); 0 outside and on its surface. Inside of a mesh is what its surface goes around."""
    deepest = depth_in(vehicle.no_mounts, places)
    for pose in vehicle.poses.values():
        if pose.mesh is not None:
            deepest = np.maximum(deepest, depths(pose.mesh, places))
    return deepest


@lru_cache(maxsize=16)
def voxels_in_body(vehicle: Vehicle, roi: Roi) -> NDArray[np.bool_]:
    """Return whether the centre of each voxel is inside the body, shape of the ROI; read-only."""
    centres = [roi.centres(axis) for axis in range(3)]
    inside = np.zeros(roi.shape, np.bool_)

    def near(low: NDArray[np.float64], high: NDArray[np.float64]) -> list[NDArray[np.bool_]]:
        return [(a < c) & (c < b) for a, b, c in zip(low, high, centres, strict=True)]

    for low, high in vehicle.interior:
        inside[np.ix_(*near(low, high))] = True
    if vehicle.mesh is not None:
        within = near(*vehicle.extents[-1])
        centres_within = [c[along] for c, along in zip(centres, within, strict=True)]
        places = np.stack(np.meshgrid(*centres_within, indexing="ij"), axis=-1)
        solid = vehicle.in_mesh(places.reshape(-1, 3))
        inside[np.ix_(*within)] |= solid.reshape(places.shape[:3])
    inside.flags.writeable = False  # shared by all callers
    return inside


def zone_in_body(zone: Zone, vehicle: Vehicle) -> tuple[bool, bool]:
    """Return whether some of a zone, and whether all of it, may be inside of the body.

    Some by the boxes around both, all by some points of the zone."""
    (x0, x1), (z0, z1) = zone.x, zone.z
    ys = [y for _, y in zone.polygon]
    low, high = np.array([x0, min(ys), z0]), np.array([x1, max(ys), z1])
    boxes = np.concatenate([vehicle.no_mounts, *(pose.extents for pose in vehicle.poses.values())])
    some = bool(((boxes[:, 0] < high) & (low < boxes[:, 1])).all(axis=1).any())
    shares = np.linspace(0.0, 1.0, 5).tolist()
    points = np.array([position(zone, *at) for at in product(shares, repeat=3)]) if some else low
    return some, some and bool((depth_in_body(vehicle, points) > 0).all())


def top_near(vehicle: Vehicle, x: Interval, y: Interval) -> float | None:
    """Return how high the body is beneath this rectangle, metres; None without a body.

    Where nothing is beneath, its nearest part counts; of a mesh the boxes around its triangles."""
    parts = vehicle.body.boxes
    if vehicle.mesh is not None:
        corners = vehicle.mesh.triangles
        around = np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
        parts = np.concatenate([parts, around])
    if not len(parts):
        return None
    low, high = np.array([x, y]).T
    apart = np.maximum(parts[:, 0, :2] - high, low - parts[:, 1, :2]).clip(min=0.0)
    away = np.hypot(*apart.T)
    return float(parts[away <= away.min() + _HAIR, 1, 2].max())


def depth_in(boxes: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far places (P, 3) are inside one of boxes (n, 2, 3), metres, (P,); 0 outside."""
    at = places[:, None]
    inside = np.minimum(at - boxes[:, 0], boxes[:, 1] - at).min(axis=2)
    return np.asarray(inside.max(axis=1, initial=0.0))
