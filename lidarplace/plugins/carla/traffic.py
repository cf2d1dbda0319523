"""Recorded traffic of one route: who was where in every frame, and the box log that it gives.

Poses are kept as CARLA gives them, left-handed, metres and degrees, so that a replay can put
everybody back exactly. They become the box log's in `box_log`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, GEOMETRY, POSE_COLUMNS
from lidarplace.rigs.pose import from_carla, rotation
from lidarplace.scenes.routes import KEEP_M

Array = NDArray[np.float64]

EGO = 0
"""The ego's number among the actors."""

BOX = ("box_x", "box_y", "box_z", "box_yaw", "length", "width", "height")
"""An actor's box in its own left-handed frame: centre, yaw in degrees, and size."""

POSE = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class Traffic:
    """What happened on a route.

    Attributes:
        actors: one row an actor, columns actor (its number), blueprint, class and `BOX`.
        poses: one row an actor and frame, columns frame, actor and `POSE` in CARLA's world.
        frames: one row a frame, the box log's columns but for the ego's pose.
    """

    actors: pd.DataFrame
    poses: pd.DataFrame
    frames: pd.DataFrame

    def write(self, folder: Path) -> None:
        """Write the tables into `folder`, one Parquet file each."""
        for name in ("actors", "poses", "frames"):
            getattr(self, name).to_parquet(folder / f"{name}.parquet", index=False)

    @classmethod
    def read(cls, folder: Path) -> "Traffic":
        """Read what `write` wrote."""
        names = ("actors", "poses", "frames")
        return cls(*(pd.read_parquet(folder / f"{name}.parquet") for name in names))


def box_log(traffic: Traffic) -> BoxLog:
    """Boxes within `KEEP_M` of the ego, in its frame; the ego itself is not among them.

    The ego frame leans with the vehicle: on a slope the road stays level in it. A box has a yaw
    only, that of its length; what it leans against the ego is left out.
    """
    where = traffic.poses.merge(traffic.actors, on="actor").merge(
        traffic.frames[["scene", "frame", "timestamp_s", "route"]], on="frame"
    )
    turn, place = _pose(where)
    centre, length = _boxes(where)
    # CARLA's origin is on the ground, but not quite under the middle of the vehicle.
    ground = centre * [1, 1, 0]

    own = (where["actor"] == EGO).to_numpy()
    rows = pd.Series(np.flatnonzero(own), index=where.loc[own, "frame"])
    ego = rows.loc[where["frame"]].to_numpy()  # the ego's row in the frame of each row
    origin = place[ego] + _turned(turn[ego], ground[ego])
    back = turn[ego].transpose(0, 2, 1)
    local = _turned(back, place + _turned(turn, centre) - origin)
    ahead = _turned(back, _turned(turn, length))

    boxes = where.assign(
        object_id=where["route"].astype(str) + "-" + where["actor"].astype(str),
        x=local[:, 0],
        y=local[:, 1],
        z=local[:, 2],
        yaw=np.arctan2(ahead[:, 1], ahead[:, 0]),
    )
    near = ~own & (np.hypot(local[:, 0], local[:, 1]) <= KEEP_M)
    forward = turn[own][:, :, 0]
    pose = (*origin[own][:, :2].T, np.arctan2(forward[:, 1], forward[:, 0]))
    frames = traffic.frames.merge(
        pd.DataFrame(
            {"frame": where.loc[own, "frame"], **dict(zip(POSE_COLUMNS, pose, strict=True))}
        ),
        on="frame",
    )
    boxes = boxes.loc[near, list(BOX_COLUMNS)].sort_values(["frame", "object_id"])
    return BoxLog(boxes.astype(dict.fromkeys(GEOMETRY, float)).reset_index(drop=True), frames)


def _turned(rotations: Array, vectors: Array) -> Array:
    """Every vector (N, 3) turned by its rotation (N, 3, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", rotations, vectors))


def _right_handed(position: Array, degrees: Array) -> tuple[Array, Array]:
    """`from_carla` on arrays: metres and degrees, (N, 3) each, to metres and radians."""
    convert: Any = from_carla  # written for numbers, but its arithmetic is elementwise
    pose = np.stack(convert(*position.T, *np.radians(degrees.T)), axis=1)
    return pose[:, :3], pose[:, 3:]


def _pose(poses: pd.DataFrame) -> tuple[Array, Array]:
    """Rotations (N, 3, 3) and places (N, 3) in a right-handed world, of CARLA's poses."""
    place, angles = np.split(poses[list(POSE)].to_numpy(np.float64), 2, axis=1)
    place, angles = _right_handed(place, angles)
    turn: Any = rotation  # (3, 3, N) for arrays of angles
    return np.moveaxis(turn(*angles.T), -1, 0), place


def _boxes(where: pd.DataFrame) -> tuple[Array, Array]:
    """Centres of the boxes and directions of their lengths in their actors' frames, (N, 3) each."""
    degrees = np.zeros((len(where), 3))
    degrees[:, 2] = where["box_yaw"]
    centre, angles = _right_handed(where[list(BOX[:3])].to_numpy(np.float64), degrees)
    yaw = angles[:, 2]
    return centre, np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=1)
