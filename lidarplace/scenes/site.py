"""A site beside the road: LiDARs on poles, instead of a vehicle, and logs as they are seen there.

A site is a vehicle without a body that stands still. Mounts, zones, ROI and requirements are in its
frame: origin on the ground at x and y of the world, turned by a yaw."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import point
from lidarplace.base.ranges import Range
from lidarplace.configuration.settings import Degrees, Distance, Length, Name, Settings
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import (
    FULL_POSE_COLUMNS,
    GEOMETRY,
    POSE_COLUMNS,
    SIZE,
    VIEWPOINT_Z,
    corners,
    count_columns,
    full_poses,
    geometry_of,
)
from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.trailer import FACES
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.mounting.zone import Zone, grid
from lidarplace.rigs.placement import Placement

POLE = Range(0.0, 15.0)
"""Height of a LiDAR on a pole or a gantry, metres."""
TRAFFIC_M = 4.5
"""Height below which a pole on a lane is in the way of vehicles, metres."""
ZONE_STEP_M = 1.0
"""Distance of the places of a zone that are checked, metres."""
RECORDER = "recorder"
"""Start of the id of the recording vehicle as an object of a site."""


class Site(Settings):
    """A place in the world of a scene from which LiDARs on poles look, instead of a vehicle."""

    x: Length | None = Field(
        None,
        description="origin of the site in the world of its map or log, metres; null: the junction "
        "with most lanes, of simulated traffic alone",
    )
    y: Length | None = Field(None, description="the same")
    yaw_deg: Degrees = Field(0.0, description="of the x axis of the site, from that of the world")
    scene: Name | None = Field(
        None, description="scene of a log whose world is meant; null: all scenes share one"
    )
    within: Distance = Field(
        30.0,
        gt=0,
        description="frames of a log count in which the recording vehicle is so near to the "
        "origin, metres: farther away nobody labelled what is at the site",
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.x is None) != (self.y is None):
            raise InputError("x and y belong together", key="y" if self.y is None else "x")
        return self

    @property
    def origin(self) -> tuple[float, float]:
        """Place in the world of a log, metres. Raises ValueError: x and y are missing."""
        if self.x is None or self.y is None:
            raise InputError("missing", key="site.x", expected="x and y in the world of the log")
        return self.x, self.y


class SiteOrVehicle(Settings):
    """A file with the keys `vehicle` and `site`, of which a site has no vehicle, not a car."""

    @model_validator(mode="before")
    @classmethod
    def _without_body(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("site") is not None and data.get("vehicle") is None:
            return data | {"vehicle": []}
        return data

    @field_validator("site", check_fields=False)
    @classmethod
    def _no_vehicle(cls, site: Site | None, info: ValidationInfo) -> Site | None:
        vehicle = info.data.get("vehicle")
        if site is not None and vehicle is not None and len(vehicle.vehicle().body.extents):
            raise InputError("a site has no vehicle", fix="remove vehicle or site")
        return site


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Buildings and lanes around a site, in its frame, where no LiDAR may be.

    Attributes:
        buildings: rows of `GEOMETRY`, shape (n, 7).
        lanes: of vehicles: x, y, yaw, half of the length, half of the width, shape (m, 5)."""

    buildings: NDArray[np.float64]
    lanes: NDArray[np.float64]

    @classmethod
    def around(
        cls,
        pose: tuple[float, float, float],
        buildings: NDArray[np.float64],
        lanes: NDArray[np.float64],
        mirrored: bool = False,
    ) -> Obstacles:
        """Return obstacles of a world around the pose of a site, x, y and yaw, in that world.

        `mirrored`: the world is the mirror image, y for -y, of that of the site."""
        side = -1.0 if mirrored else 1.0
        (x0, y0, turn), moved = pose, []
        for rows, yaw in ((buildings, 6), (lanes, 2)):
            rows = rows.copy()
            rows[:, :2] = _in_frame(turn, rows[:, 0] - x0, rows[:, 1] - y0) * [1.0, side]
            rows[:, yaw] = side * (rows[:, yaw] - turn)
            moved.append(rows)
        return cls(*moved)

    def within(self, distance: float) -> Obstacles:
        """Return those of which some part may be within a distance of the origin, metres."""
        reach = [
            np.hypot(rows[:, 0], rows[:, 1]) - scale * np.hypot(rows[:, 3], rows[:, 4]) <= distance
            for rows, scale in ((self.buildings, 0.5), (self.lanes, 1.0))
        ]
        return Obstacles(self.buildings[reach[0]], self.lanes[reach[1]])

    def check(self, rig: Placement) -> None:
        """Raise ValueError for the first LiDAR of a rig where no pole or gantry can hold it."""
        for number, mount in enumerate(rig.mounts, start=1):
            self.check_place(mount.position, f"LiDAR {number}", repr(rig.name))

    def check_zone(self, zone: Zone) -> None:
        """Raise ValueError unless a pole or a gantry can be everywhere in a zone."""
        for place in grid(zone, ZONE_STEP_M):
            self.check_place(place, "a part of it")

    @property
    def footprints(self) -> NDArray[np.float64]:
        """Buildings as rectangles like `lanes`, shape (n, 5)."""
        return self.buildings[:, [0, 1, 6, 3, 4]] * [1, 1, 1, 0.5, 0.5]

    def check_place(self, position: NDArray[np.float64], name: str, place: str = "") -> None:
        """Raise ValueError unless a pole or a gantry can hold what has this name there."""
        x, y, z = position.tolist()
        POLE.check("z", z, place=": ".join(filter(None, (place, name))))
        name = f"{name} at {point(x, y, z)}"
        if (_holds(self.footprints, x, y) & (z <= self.buildings[:, 5])).any():
            raise InputError(f"{name} is inside of a building", place=place, fix="move it")
        if z < TRAFFIC_M and _holds(self.lanes, x, y).any():
            expected = f"a place off the lanes, or z from {TRAFFIC_M:g} m, as on a gantry"
            raise InputError(f"{name} is in the way of vehicles", place=place, expected=expected)


@dataclass(frozen=True, eq=False)
class Poles(Vehicle):
    """Carrier of the LiDARs of a site: no body; its boxes are keep-outs.

    Attributes:
        around: buildings and lanes, which pictures show."""

    around: Obstacles = field(kw_only=True, compare=False)
    interior_name = "a building"

    @property
    def body(self) -> Vehicle:
        """Vehicle of this name without boxes."""
        return Vehicle(self.name, np.empty((0, 2, 3)))

    @property
    def with_walls(self) -> Poles:
        """Poles with the buildings as a surface, which stops rays and holds no object."""
        if not len(buildings := self.around.buildings):
            return self
        faces = 8 * np.arange(len(buildings))[:, None, None] + FACES
        walls = Mesh(corners(buildings).reshape(-1, 3), faces.reshape(-1, 3))
        return replace(self, mesh=walls)

    def in_mesh(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which of places (P, 3) are inside of a building."""
        inside = np.zeros(len(places), np.bool_)
        for building in self.around.buildings:
            x, y, z = (places - building[:3]).T
            at = np.column_stack([_in_frame(building[6], x, y), z])
            inside |= (np.abs(at) < 0.5 * building[3:6]).all(axis=1)
        return inside


def _holds(rectangles: NDArray[np.float64], x: float, y: float) -> NDArray[np.bool_]:
    """Return which rectangles, x, y, yaw and half of their sides, hold a place."""
    at = _in_frame(rectangles[:, 2], x - rectangles[:, 0], y - rectangles[:, 1])
    return np.asarray((np.abs(at) <= rectangles[:, 3:]).all(axis=1))


def _in_frame(yaw: Any, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places in a frame with a yaw, one or one each, about the same origin, shape (n, 2)."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * x + s * y, c * y - s * x], axis=1)


def seen_from(log: BoxLog, site: Site) -> BoxLog:
    """Return the log in the frame of a site, as far as the recording vehicle was near to it.

    The recording vehicle becomes an object, a Car of the size of `Vehicle.car`: no log has its
    size. Boxes stay upright. The ground is that under the vehicle where it was nearest. Counts of
    real points and the recorded rig are left out, as they are of the vehicle.

    Raises ValueError as `near` does, and if no frame is."""
    frames, (x0, y0) = log.frames[near(log.frames, site)], site.origin
    if frames.empty:
        where = f"within {site.within:g} m of the site"
        raise InputError(f"no frame with the recording vehicle {where}", key="site")
    poses = full_poses(frames)
    turns = np.array([turn for turn, _ in poses.values()])
    places = np.array([place for _, place in poses.values()]) - [x0, y0, 0.0]
    places[:, 2] -= (ground := places[np.hypot(*places[:, :2].T).argmin(), 2])
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])].drop(
        columns=count_columns(log.boxes)
    )
    boxes = pd.concat([boxes, _recorder(frames)], ignore_index=True)
    row = pd.Index(frames["frame"]).get_indexer(boxes["frame"])
    x, y, z = (
        np.einsum("nij,nj->ni", turns[row], boxes[["x", "y", "z"]].to_numpy(np.float64))
        + places[row]
    ).T
    yaw = math.radians(site.yaw_deg)
    turned = boxes["yaw"].to_numpy(np.float64) + frames["ego_yaw"].to_numpy(np.float64)[row] - yaw
    turned -= 2 * np.pi * np.round(turned / (2 * np.pi))
    size = boxes[list(SIZE)].to_numpy(np.float64)
    centre = np.column_stack([_in_frame(yaw, x, y), z])
    still = dict(
        zip((*POSE_COLUMNS, *FULL_POSE_COLUMNS), (x0, y0, yaw, ground, 0.0, 0.0), strict=True)
    )
    return replace(
        log,
        boxes=boxes.assign(**geometry_of(centre, size, turned)),
        frames=frames.assign(**still, **{VIEWPOINT_Z: POLE.high}).reset_index(drop=True),
        rigs={},
    )


def near(frames: pd.DataFrame, site: Site) -> NDArray[np.bool_]:
    """Return whether the recording vehicle is near to the site, of every frame, shape (F,).

    Frames without a pose, and of another scene, are not. Raises ValueError: poses, or x and y of
    the site, are missing."""
    x, y = site.origin
    if missing := [name for name in POSE_COLUMNS if name not in frames.columns]:
        wrong = "missing column; a site needs the pose of the recording vehicle"
        raise InputError(wrong, place="frames", key=", ".join(missing))
    away = np.hypot(frames["ego_x"] - x, frames["ego_y"] - y)
    is_near = (away <= site.within) & frames["ego_yaw"].notna()
    of_scene = (site.scene is None) | (frames["scene"] == site.scene)
    return np.asarray(is_near & of_scene, bool)


def _recorder(frames: pd.DataFrame) -> pd.DataFrame:
    """Return the recording vehicle as a box of every frame, in its own frame."""
    extents = Vehicle.car().extents
    low, high = extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)
    size, centre = high - low, (low + high) / 2
    box = dict(zip(GEOMETRY, (*centre, *size, 0.0), strict=True))
    ids = f"{RECORDER}-" + frames["scene"].astype(str) + "-" + frames["route"].astype(str)
    of_frame = frames[["scene", "frame", "timestamp_s"]]
    return of_frame.assign(object_id=ids, **{"class": "Car"}, **box)
