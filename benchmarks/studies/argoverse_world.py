"""The static world of real sweeps against boxes and map of the data set; see docs/reality.md.

    lidarplace convert argoverse data/argoverse2 logs/world --keep-ignored \
        --clouds data/argoverse2 --world
    python benchmarks/studies/argoverse_world.py av2-api logs/world

`av2-api` is a clone of Argoverse 2's API, whose test data are the sweeps (argoverse_logs.py). Only
the world itself is read with this project; points, boxes and the map's ground are those of the data
set, in its city frame. Points are nearer than 50 m.
"""

from __future__ import annotations

import json
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from argoverse_logs import LOGS
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.logs.world import CELL_M, PATCH_M, PATCHES, TILE_M, cell_keys, read_worlds

REACH_M = 50.0
STANDS_M = 0.6
"""A point so high above the map's ground is not of it."""
FLAT_M = 0.2
"""A point so near to the map's ground is of it."""
OFF_M = 0.3
BANDS_M = (0, 10, 20, 40, 60)
POSE = ["qx", "qy", "qz", "qw"], ["tx_m", "ty_m", "tz_m"]


class MapGround:
    """Heights of the map, in the city frame."""

    def __init__(self, folder: Path) -> None:
        (raster,), (place,) = folder.glob("*ground_height*.npy"), folder.glob("*Sim2_city.json")
        self.heights = np.load(raster).astype(float)
        told = json.loads(place.read_text())
        self.turn, self.shift = np.reshape(told["R"], (2, 2)), np.array(told["t"])
        self.scale = told["s"]

    def at(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height at x and y, NaN where the map has none."""
        column, row = (((places[:, :2] @ self.turn.T) + self.shift) * self.scale).astype(int).T
        rows, columns = self.heights.shape
        there = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        found = np.full(len(places), np.nan)
        found[there] = self.heights[row[there], column[there]]
        return found


def pose(table: pd.DataFrame) -> tuple[NDArray[np.float64], Rotation]:
    return table[POSE[1]].to_numpy(float), Rotation.from_quat(table[POSE[0]].to_numpy(float))


def in_a_box(points: NDArray[np.float64], boxes: pd.DataFrame) -> NDArray[np.bool_]:
    inside = np.zeros(len(points), bool)
    for middle, turn, size in zip(
        *pose(boxes), boxes[["length_m", "width_m", "height_m"]].to_numpy(float), strict=True
    ):
        inside |= (np.abs(turn.inv().apply(points - middle)) <= size / 2).all(axis=1)
    return inside


def main(clone: Path, log: Path) -> None:
    worlds = read_worlds(log / "world.npz")
    for name, world in worlds.items():
        source = clone / "tests" / "unit" / LOGS[name] / name
        ground = MapGround(source / "map")
        poses = pd.read_feather(source / "city_SE3_egovehicle.feather").set_index("timestamp_ns")
        boxes = pd.read_feather(source / "annotations.feather")
        hit, high, of_box, low, vehicle = [], [], [], [], []
        for path in sorted((source / "sensors" / "lidar").glob("*.feather")):
            own = pd.read_feather(path)[["x", "y", "z"]].to_numpy(float)
            own = own[np.hypot(own[:, 0], own[:, 1]) < REACH_M]
            labelled = in_a_box(own, boxes[boxes["timestamp_ns"] == int(path.stem)])
            at, turn = pose(poses.loc[[int(path.stem)]])
            city = turn[0].apply(own) + at[0]
            above = city[:, 2] - ground.at(city)
            cells = np.floor((city - world.origin) / CELL_M).astype(np.int64)
            hit.append(cell_keys(cells))
            of_box.append(labelled)
            high.append(~labelled & (above >= STANDS_M))
            low.append(~labelled & (np.abs(above) <= FLAT_M))
            vehicle.append(at[0])
        keys, labelled = np.concatenate(hit), np.concatenate(of_box)
        stopped = np.isin(keys, world.keys)
        middle = world.boxes().reshape(-1, 2, 3).mean(axis=1)
        near = np.hypot(*(middle[:, :2] - vehicle[0][:2]).T) < REACH_M - 1
        seen = np.isin(world.keys[near], keys[~labelled])
        print(f"{name}: {len(vehicle)} sweeps, {len(keys):,} points, {len(world.keys):,} cells")
        print(f"points that stand, in a cell: {stopped[np.concatenate(high)].mean():.1%}")
        print(f"points in a box, in a cell: {stopped[labelled].mean():.1%}")
        print(f"points on the ground, in a cell: {stopped[np.concatenate(low)].mean():.1%}")
        print(f"cells with a point in no box: {seen.mean():.1%}")
        along = np.arange(PATCHES + 1) * PATCH_M
        corners = np.array([np.meshgrid(i * TILE_M + along, j * TILE_M + along, indexing="ij")
                            for i, j in world.tiles])  # fmt: skip
        flat = corners.transpose(0, 2, 3, 1).reshape(-1, 2) + world.origin[:2]
        off = world.heights.ravel() + world.origin[2] - ground.at(flat)
        away = np.min([np.hypot(*(flat - at[:2]).T) for at in vehicle], axis=0)
        for first, last in pairwise(BANDS_M):
            own = off[(away >= first) & (away < last) & np.isfinite(off)]
            print(f"ground off by more than {OFF_M} m, {first} to {last} m: "
                  f"{(np.abs(own) > OFF_M).mean():.0%} of {len(own)} places")  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
