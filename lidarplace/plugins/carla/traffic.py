"""Recorded traffic of one route, and the box log that it gives.

Poses are kept as CARLA gives them, left-handed, metres and degrees, so that a replay can put
everybody back exactly."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, GEOMETRY, POSE_COLUMNS
from lidarplace.rigs.pose import from_carla
from lidarplace.scenes.datasets.se3 import Poses
from lidarplace.scenes.routes import KEEP_M

EGO = 0  # the ego's number among the actors
BOX = ("box_x", "box_y", "box_z", "box_yaw", "length", "width", "height")
"""An actor's box in its own left-handed frame: centre, yaw in degrees, and size."""

POSE = ("x", "y", "z", "roll", "pitch", "yaw")


class Traffic(NamedTuple):
    """Recorded traffic of a route."""

    actors: pd.DataFrame  # one row an actor: actor (its number), blueprint, class and `BOX`
    poses: pd.DataFrame  # one row an actor and frame: frame, actor and `POSE` in CARLA's world
    frames: pd.DataFrame  # one row a frame, the box log's columns but for the ego's pose

    def write(self, folder: Path) -> None:
        """Write the tables into `folder`, one Parquet file each."""
        for name in self._fields:
            getattr(self, name).to_parquet(folder / f"{name}.parquet", index=False)

    @classmethod
    def read(cls, folder: Path) -> "Traffic":
        """Read what `write` wrote."""
        return cls(*(pd.read_parquet(folder / f"{name}.parquet") for name in cls._fields))


def box_log(traffic: Traffic) -> BoxLog:
    """Log the boxes within `KEEP_M` of the ego, in its frame; the ego itself is not among them.

    The ego frame leans with the vehicle: on a slope the road stays level in it. A box has a yaw
    only, that of its length; what it leans against the ego is left out."""
    where = traffic.poses.merge(traffic.actors, on="actor").merge(
        traffic.frames[["scene", "frame", "timestamp_s", "route"]], on="frame"
    )
    actor = _poses(where[list(POSE)].to_numpy(np.float64))
    of_box = np.zeros((len(where), len(POSE)))
    of_box[:, [0, 1, 2, 5]] = where[list(BOX[:4])]
    box = _poses(of_box)
    is_ego = (where["actor"] == EGO).to_numpy()
    rows = pd.Series(np.flatnonzero(is_ego), index=where.loc[is_ego, "frame"])
    # CARLA's origin is on the ground, but not quite under the middle of the vehicle.
    ego = actor.moved(box.position * [1, 1, 0])[rows.loc[where["frame"]].to_numpy()]
    local = box.posed_by(actor).seen_from(ego)
    boxes = where.assign(
        object_id=where["route"].astype(str) + "-" + where["actor"].astype(str),
        **dict(zip("xyz", local.position.T, strict=True)),
        yaw=local.yaw,
    )
    near = ~is_ego & (np.hypot(*local.position[:, :2].T) <= KEEP_M)
    poses = where[["frame"]].assign(**ego.ego_columns())[is_ego]
    frames = traffic.frames.merge(poses[["frame", *POSE_COLUMNS]], on="frame")
    boxes = boxes.loc[near, list(BOX_COLUMNS)].sort_values(["frame", "object_id"])
    return BoxLog(boxes.astype(dict.fromkeys(GEOMETRY, float)).reset_index(drop=True), frames)


def _poses(carla: NDArray[np.float64]) -> Poses:
    """Convert rows of `POSE`, left-handed, metres and degrees, to a right-handed world."""
    convert: Any = from_carla  # written for numbers, but its arithmetic is elementwise
    x, y, z, roll, pitch, yaw = convert(*carla[:, :3].T, *np.radians(carla[:, 3:].T))
    turned = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))
    return Poses(np.stack([x, y, z], axis=1), turned)
