"""Buildings along the roads of a town: rectangles that stand on no lane and in no other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidarplace.logs.boxes import BUILDING_COLUMNS
from lidarplace.scenes.sumo.trajectories import LEVEL_M, Trajectories

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.edge import Edge


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


ROUNDS = (((12.0, 26.0), (8.0, 14.0), (0.3, 16.0)), ((7.0, 12.0), (6.0, 9.0), (10.0, 50.0)))
"""Length along the road and depth of a building, and the gap to the next one, metres: large ones
first, then smaller ones here and there where room is left. Together they line two thirds of a
street."""

SETBACK_M = (0.5, 4.0)
"""From the outer edge of the road, its sidewalk included, to the wall."""

VERGE_M = (4.0, 12.0)
"""The same for every lane, where there is no sidewalk or the road is broad."""

BROAD = 3
"""From so many lanes one way on a road counts as a highway: houses keep away, and there are none
between its halves."""

STOREYS = (1, 6)
STOREY_M = 3.2

REACH_M = 80.0
"""Buildings farther from every recorded pose are left out."""


def build_along(network: Net, seed: int, name: str, lefthand: bool = False) -> pd.DataFrame:
    """Buildings of the town `name`, columns `BUILDING_COLUMNS`, in the frame of the network.

    The log is flat, so all stand on z = 0, and none over or under a bridge.
    `network` was read with its junctions' inner lanes; `lefthand` says that vehicles keep left.
    """
    rng = np.random.default_rng(seed)
    roads, half_roads, polygons = _roads(network)
    edges = sorted(network.getEdges(withInternal=False), key=lambda edge: edge.getID())
    ends = {(edge.getFromNode().getID(), edge.getToNode().getID()) for edge in edges}
    pose, half = np.empty((0, 3)), np.empty((0, 2))
    for lengths, depths, gaps in ROUNDS:
        fronts = [
            front
            for edge in edges
            for side in _sides(edge, ends)
            for front in _frontage(edge, side, lefthand, lengths, depths, gaps, rng)
        ]
        if not fronts:
            continue
        new = np.array(fronts)
        new_pose, new_half = new[:, :3], new[:, 3:]
        free = ~_meets_any(new_pose, new_half, roads, half_roads)
        free &= ~_meets_any(new_pose, new_half, pose, half)
        free &= ~_inside_any(new_pose[:, :2], polygons)
        new_pose, new_half = new_pose[free], new_half[free]
        first = _first_come(new_pose, new_half)
        pose = np.concatenate([pose, new_pose[first]])
        half = np.concatenate([half, new_half[first]])
    height = STOREY_M * rng.integers(STOREYS[0], STOREYS[1] + 1, len(pose)) + rng.uniform(
        0, 1, len(pose)
    )
    columns = (*pose[:, :2].T, height / 2, *(2 * half.T), height, pose[:, 2])
    table = pd.DataFrame(dict(zip(BUILDING_COLUMNS[1:], columns, strict=True)))
    table.insert(0, "scene", pd.Series(name, index=table.index, dtype=str))
    return table


def within_reach(buildings: pd.DataFrame, positions: NDArray[np.float64]) -> pd.DataFrame:
    """Buildings of which some part may be within `REACH_M` of one of `positions`, (F, 2)."""
    distance, _ = cKDTree(positions).query(buildings[["x", "y"]].to_numpy(np.float64))
    radius = np.hypot(buildings["length"], buildings["width"]) / 2
    near = np.asarray(distance) - radius <= REACH_M
    return buildings[near].reset_index(drop=True)


def _sides(edge: Edge, ends: set[tuple[str, str]]) -> tuple[int, ...]:
    """Sides of an edge for buildings: -1 the kerb's, 1 the other, where no traffic comes back."""
    back = (edge.getToNode().getID(), edge.getFromNode().getID())
    return (-1,) if back in ends or _drive_lanes(edge) >= BROAD else (-1, 1)


def _drive_lanes(edge: Edge) -> int:
    return sum(lane.allows("passenger") for lane in edge.getLanes())


def _frontage(
    edge: Edge,
    side: int,
    lefthand: bool,
    lengths: tuple[float, float],
    depths: tuple[float, float],
    gaps: tuple[float, float],
    rng: np.random.Generator,
) -> list[tuple[float, float, float, float, float]]:
    """Buildings side by side along one side of an edge: x, y, yaw, half length, half depth."""
    lanes = edge.getLanes()
    lane = lanes[0] if side < 0 else lanes[-1]
    left = -side if lefthand else side
    shape = np.array(lane.getShape(), np.float64)[:, :2]
    steps = np.diff(shape, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    sidewalk = any(
        lane.allows("pedestrian") and not lane.allows("passenger") for lane in edge.getLanes()
    )
    lane_count = min(max(_drive_lanes(edge), 1), BROAD)
    street = sidewalk and lane_count < BROAD
    setbacks = SETBACK_M if street else np.multiply(VERGE_M, lane_count)
    found = []
    place = rng.uniform(-lengths[0], gaps[1])
    while place < along[-1]:
        length, depth = rng.uniform(*lengths), rng.uniform(*depths)
        setback = rng.uniform(*setbacks)
        ends = np.clip([place, place + length], 0, along[-1])
        if ends[1] > ends[0]:
            (x0, x1), (y0, y1) = (np.interp(ends, along, shape[:, k]) for k in range(2))
            yaw = np.arctan2(y1 - y0, x1 - x0)
            out = left * (lane.getWidth() / 2 + setback + depth / 2)
            x, y = (x0 + x1) / 2 - out * np.sin(yaw), (y0 + y1) / 2 + out * np.cos(yaw)
            found.append((x, y, yaw, length / 2, depth / 2))
        place += length + rng.uniform(*gaps)
    return found


def _roads(
    network: Net,
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[NDArray[np.float64]]]:
    """What is kept free: rectangles (pose (R, 3), half size (R, 2)) and polygons.

    Every piece of every lane and crossing, with its width; and the outlines of junctions and
    walking areas, once as polygons and once as rectangles without width.
    """
    pieces: list[NDArray[np.float64]] = []
    polygons = [
        np.array(node.getShape(), np.float64)[:, :2]
        for node in network.getNodes()
        if len(node.getShape()) > 2
    ]
    for edge in network.getEdges():
        for lane in edge.getLanes():
            shape = np.array(lane.getShape(), np.float64)[:, :2]
            if edge.getFunction() == "walkingarea":
                polygons.append(shape)
            else:
                width = np.full(len(shape) - 1, lane.getWidth() / 2)
                pieces.append(np.column_stack([shape[:-1], shape[1:], width]))
    for polygon in polygons:
        outline = np.column_stack([polygon, np.roll(polygon, -1, axis=0)])
        pieces.append(np.column_stack([outline, np.zeros(len(polygon))]))
    start, end, width = np.split(np.concatenate(pieces), [2, 4], axis=1)
    step = end - start
    # Half a lane's width longer at both ends, so that bends are covered.
    half_length = np.hypot(step[:, 0], step[:, 1]) / 2 + width[:, 0]
    yaw = np.arctan2(step[:, 1], step[:, 0])
    pose = np.column_stack([(start + end) / 2, yaw])
    return pose, np.column_stack([half_length, width]), polygons


def _pairs(
    pose_a: NDArray[np.float64],
    half_a: NDArray[np.float64],
    pose_b: NDArray[np.float64],
    half_b: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Indices (P, 2) of rectangles of a and b that meet."""
    if not len(pose_a) or not len(pose_b):
        return np.empty((0, 2), np.int64)
    radius_a, radius_b = np.hypot(*half_a.T), np.hypot(*half_b.T)
    # Long ones are searched on their own, lest their reach makes all others neighbours.
    found = []
    edges = np.quantile(radius_b, [0, 0.5, 0.9, 1])
    group = np.digitize(radius_b, edges[1:-1])
    for g in range(3):
        members = np.flatnonzero(group == g)
        if not len(members):
            continue
        near = cKDTree(pose_b[members, :2]).query_ball_point(
            pose_a[:, :2], radius_a + radius_b[members].max()
        )
        counts = [len(n) for n in near]
        a = np.repeat(np.arange(len(pose_a)), counts)
        b = members[np.concatenate([np.array(n, np.int64) for n in near])]
        meet = rectangles_meet(pose_a[a], half_a[a], pose_b[b], half_b[b])
        found.append(np.column_stack([a[meet], b[meet]]))
    return np.concatenate(found)


def _meets_any(
    pose: NDArray[np.float64],
    half: NDArray[np.float64],
    others: NDArray[np.float64],
    half_others: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Which rectangles meet one of the others."""
    met = np.zeros(len(pose), bool)
    met[_pairs(pose, half, others, half_others)[:, 0]] = True
    return met


def _first_come(pose: NDArray[np.float64], half: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which rectangles stay if each gives way to those that stay before it."""
    stays = np.ones(len(pose), bool)
    pairs = _pairs(pose, half, pose, half)
    for a, b in pairs[np.lexsort(pairs.T)]:  # by the later one
        if a < b and stays[a]:
            stays[b] = False
    return stays


def _inside_any(
    points: NDArray[np.float64], polygons: list[NDArray[np.float64]]
) -> NDArray[np.bool_]:
    """Which points (P, 2) are inside a polygon: an odd number of edges to their right."""
    inside = np.zeros(len(points), bool)
    x, y = points[:, :1], points[:, 1:]
    for polygon in polygons:
        (x0, y0), (x1, y1) = polygon.T, np.roll(polygon, -1, axis=0).T
        straddles = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            right = x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        inside |= (straddles & right).sum(axis=1) % 2 == 1
    return inside
