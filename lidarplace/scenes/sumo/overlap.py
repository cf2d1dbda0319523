"""Which road users overlap: separating axes of oriented rectangles."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.scenes.sumo.trajectories import LEVEL_M, Trajectories


def overlaps(traffic: Trajectories) -> NDArray[np.int64]:
    """All pairs of road users on one level whose rectangles on the ground meet.

    Shape (P, 3), int64: recorded step, and the two indices, ascending.
    """
    half = np.array([(user.length, user.width) for user in traffic.users]) / 2
    radius = np.hypot(half[:, 0], half[:, 1])
    reach = radius[:, None] + radius
    found = []
    for step, pose in enumerate(traffic.pose):
        distance = np.hypot(*(pose[:, None, :2] - pose[None, :, :2]).transpose(2, 0, 1))
        level = np.abs(traffic.z[step][:, None] - traffic.z[step]) <= LEVEL_M
        a, b = np.nonzero(np.triu((distance <= reach) & level, 1))  # False where NaN
        meet = rectangles_meet(pose[a], half[a], pose[b], half[b])
        found.append(np.stack([np.full(meet.sum(), step), a[meet], b[meet]], axis=1))
    return np.concatenate(found)


def rectangles_meet(
    pose_a: NDArray[np.float64],
    half_a: NDArray[np.float64],
    pose_b: NDArray[np.float64],
    half_b: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether the a-th and the b-th of P rectangles share a point, shape (P,).

    Poses are (P, 3): x, y, yaw; `half` is (P, 2): half the length and width. Two convex shapes are
    apart exactly if some edge's normal separates them; rectangles have two normals each.
    """
    offset = pose_b[:, :2] - pose_a[:, :2]
    turn = pose_b[:, 2] - pose_a[:, 2]
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    meet = np.ones(len(offset), bool)
    for pose, own, other in ((pose_a, half_a, half_b), (pose_b, half_b, half_a)):
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        along = np.abs(c * offset[:, 0] + s * offset[:, 1])
        across = np.abs(c * offset[:, 1] - s * offset[:, 0])
        meet &= along <= own[:, 0] + cos * other[:, 0] + sin * other[:, 1]
        meet &= across <= own[:, 1] + sin * other[:, 0] + cos * other[:, 1]
    return meet
