"""Frames that hang from each other by fixed transforms, and where LiDARs among them are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.rig_files.mounted import MountedLidar, mount_of, named_like

BASE = "base_link"
"""The frame of a vehicle, as ROS calls it (REP 105); in its place the root, if there is one."""


@dataclass(frozen=True)
class Joint:
    """What holds a frame.

    Attributes:
        parent, child: frames.
        position: of the child in its parent, shape (3,), metres.
        rotation: child to parent, shape (3, 3).
        moves: how the child moves against its parent; "" if it does not.
    """

    parent: str
    child: str
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]
    moves: str = ""


def lidars_of(joints: Sequence[Joint], only: Sequence[str], source: str) -> list[MountedLidar]:
    """The frames that patterns name, in the frame of the vehicle.

    Raises:
        ValueError: frames hang together otherwise than as a tree, no pattern is given or one fits
            no frame, or a frame of a LiDAR moves.
    """
    holds: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in holds:
            raise ValueError(f"{source}: frame {joint.child} has two parents")
        holds[joint.child] = joint
    roots = list(dict.fromkeys(j.parent for j in joints if j.parent not in holds))
    base = BASE if BASE in holds or BASE in roots else roots[0] if len(roots) == 1 else None
    if base is None:
        listed = ", ".join(roots) or "none, as they hang from each other in a ring"
        raise ValueError(f"{source}: no frame {BASE}, and not one root; found {listed}")
    if not only:
        raise ValueError(
            f"{source}: which frames are LiDARs? Name them by --only, which takes *, too; found "
            f"{', '.join(holds)}"
        )
    names = named_like(list(holds), only, source)
    return [_placed(name, base, holds, source) for name in names]


def _placed(name: str, base: str, holds: Mapping[str, Joint], source: str) -> MountedLidar:
    position, matrix = np.zeros(3), np.eye(3)
    frame, steps = name, 0
    while frame != base:
        if frame not in holds or steps > len(holds):
            raise ValueError(f"{source}: frame {name} does not hang from {base}")
        joint = holds[frame]
        if joint.moves:
            raise ValueError(f"{source}: frame {name} hangs from a joint that is {joint.moves}")
        position = joint.position + joint.rotation @ position
        matrix = joint.rotation @ matrix
        frame, steps = joint.parent, steps + 1
    return MountedLidar(name, mount_of(position, matrix))
