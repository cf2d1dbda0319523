"""Milliseconds to cast and collect the paper's rays in a believable street, beside embreex.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/raycast.py

A street with 20 buildings and 34 road users, 256 parts in all. 4 LiDARs x 16 beams x 5,625 azimuth
steps = 360,000 rays of `line_roll` are cast with the kernel of `lidarplace.clouds.raycast`
(float64; ground and own body too) and with embreex (float32, triangles of the same parts). Then the
returns become points: drop-off, noise, cut to the paper's front ROI, merging. Minimum of 40 runs,
taken in turns. At the end every ray is compared: those that meet another object with embreex are
counted, and how far beside them a ray of ours meets that object too.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from lidarplace import PAPER_PLACEMENTS
from lidarplace.clouds.ground import Ground, square
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.raycast import EVERYWHERE, GROUND, NOTHING, cast
from lidarplace.clouds.returns import CloudPart, sample_points
from lidarplace.clouds.shapes import BUILDING, Parts, shapes_of
from lidarplace.clouds.surroundings import facades
from lidarplace.rigs.placement import Placement

ROAD_USERS = 34
PLACEMENT = PAPER_PLACEMENTS["line_roll"]
FRONT = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)
RUNS = 40


def street(seed: int = 0) -> Parts:
    """Ten buildings on either side of a street along x, traffic on it, people beside it."""
    rng = np.random.default_rng(seed)
    sides = np.repeat([-1.0, 1.0], 10)
    buildings = np.zeros((20, 7))
    buildings[:, 0] = np.tile(np.linspace(-72, 72, 10), 2) + rng.uniform(-1, 1, 20)
    buildings[:, 1] = sides * rng.uniform(17, 20, 20)
    buildings[:, 3:6] = rng.uniform((11, 9, 6), (14, 12, 18), (20, 3))
    buildings[:, 2] = buildings[:, 5] / 2
    rows = []
    for lane in (-5.2, -1.7, 1.7, 5.2):
        for place in range(-3, 4):
            x = 20.0 * place + rng.uniform(-4, 4)
            if lane == -1.7 and abs(x) < 8:
                continue
            kind = rng.choice(["Car"] * 8 + ["truck", "bicycle"])
            size = {"Car": (4.5, 1.8, 1.5), "truck": (6.4, 2.5, 3.0), "bicycle": (1.7, 0.6, 1.75)}
            name = "Car" if kind == "Car" else "Cyclist"
            yaw = rng.normal(0, 0.05) + (np.pi if lane > 0 else 0.0)
            rows.append((name, x, lane, size[kind][2] / 2, *size[kind], yaw))
    while len(rows) < ROAD_USERS:
        x, y = rng.uniform(-40, 40), rng.choice([-9.0, 9.0])
        rows.append(("Pedestrian", x, y, 0.875, 0.55, 0.6, 1.75, rng.uniform(-3, 3)))
    columns = ["class", "x", "y", "z", "length", "width", "height", "yaw"]
    boxes = pd.DataFrame(rows, columns=columns)
    boxes["object_id"] = everything = np.arange(len(boxes))
    objects = shapes_of(boxes).parts(everything, boxes[columns[1:]].to_numpy(np.float64))
    return objects.and_(facades(buildings, seed))


def triangles(parts: Parts) -> NDArray[np.float32]:
    """Twelve triangles a part, shape (12 P, 3, 3)."""
    x, y, z, length, width, height, yaw, front, rear, side = parts.geometry.T
    corners = np.empty((len(parts), 8, 3))
    for n in range(8):
        top = float(n >= 4)
        lx = length / 2 - top * front if n & 1 else top * rear - length / 2
        ly = (width / 2 - top * side) * (1 if n & 2 else -1)
        corners[:, n, 0] = x + np.cos(yaw) * lx - np.sin(yaw) * ly
        corners[:, n, 1] = y + np.sin(yaw) * lx + np.cos(yaw) * ly
        corners[:, n, 2] = z + (top - 0.5) * height
    faces = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    halves = [half for a, b, c, d in faces for half in ((a, b, c), (a, c, d))]
    return corners[:, halves].reshape(-1, 3, 3).astype(np.float32)


class Embree:
    """The same rays with embreex; scene and rays are ready before."""

    def __init__(self, placement: Placement, parts: Parts) -> None:
        self.parts = parts
        far = np.array([[-1000, -1000, 0], [2000, -1000, 0], [-1000, 2000, 0]], np.float32)
        self.scene = EmbreeScene()
        TriangleMesh(self.scene, np.concatenate([triangles(self.parts), far[None]]))
        directions = placement.lidar.directions()
        self.rays = [
            (
                np.tile(mount.position, (len(directions), 1)).astype(np.float32),
                (directions @ mount.rotation.T).astype(np.float32),
            )
            for mount in placement.mounts
        ]

    def distances(self) -> list[NDArray[np.float32]]:
        return [self.scene.run(*rays, query="DISTANCE") for rays in self.rays]

    def targets(self, reach: float) -> NDArray[np.int64]:
        """What every ray of every LiDAR meets, as in `Hits.target`."""
        found = np.concatenate([self.scene.run(*rays, query="INTERSECT") for rays in self.rays])
        owners = np.append(self.parts.owner, GROUND)
        targets = np.where(found < 0, NOTHING, owners[found // 12])
        return np.where(np.concatenate(self.distances()) > reach, NOTHING, targets)


def best_of(runs: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Least milliseconds of each."""
    best = dict.fromkeys(runs, np.inf)
    for _ in range(RUNS):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], (time.perf_counter() - start) * 1e3)
    return best


def main() -> None:
    parts = body_parts(None).and_(street())
    lidar = PLACEMENT.lidar
    hits = [cast(mount, lidar, parts) for mount in PLACEMENT.mounts]
    noisy = replace(lidar, range_noise=0.02, drop_off=0.1)
    points = np.empty((len(hits) * lidar.rays, 4), np.float32)
    ground = Ground(square(0), (0.0, 0.0, 0.3))

    def cast_all(crop: tuple[float, ...] = EVERYWHERE) -> None:
        for mount, into in zip(PLACEMENT.mounts, hits, strict=True):
            cast(mount, lidar, parts, crop, into=into)

    def sample_all() -> int:
        count = 0
        for m, mount in enumerate(PLACEMENT.mounts):
            free = points[count:]
            count += sample_points(mount, noisy, hits[m], ground, FRONT, CloudPart((0, 0, m)), free)
        return count

    embree = Embree(PLACEMENT, parts)
    best = best_of(
        {
            "lidarplace": cast_all,
            "lidarplace, front ROI": lambda: cast_all(FRONT),
            "embreex": embree.distances,
            "points": sample_all,
        }
    )
    rays = len(PLACEMENT.mounts) * lidar.rays
    buildings = int((parts.owner == BUILDING).sum())
    print(
        f"{rays:,} rays, {len(parts)} parts of which {buildings} buildings, minimum of {RUNS} runs"
    )
    for name in ("lidarplace", "lidarplace, front ROI", "embreex"):
        print(f"{name:22s}{best[name]:7.2f} ms  {rays / best[name] / 1e3:6.1f} Mrays/s")
    print(f"{'points':22s}{best['points']:7.2f} ms  {sample_all():,} points of the front ROI")
    compare(embree.targets(lidar.range), parts)


def compare(theirs: NDArray[np.int64], parts: Parts) -> None:
    """Print how many rays meet another object than with embreex, and how near to an edge."""

    def targets(turned_by: dict[str, float]) -> NDArray[np.int32]:
        mounts = [
            replace(mount, **{axis: getattr(mount, axis) + a for axis, a in turned_by.items()})
            for mount in PLACEMENT.mounts
        ]
        return np.concatenate([cast(m, PLACEMENT.lidar, parts).target for m in mounts])

    differ = np.flatnonzero(targets({}) != theirs)
    print(f"{len(differ)} of {len(theirs):,} rays meet another object with embreex")
    # A ray that passes an edge meets what embreex says when it is turned by a hair.
    for hair in (1e-6, 1e-5):
        for axis in ("roll", "pitch", "yaw"):
            for angle in (-hair, hair):
                differ = differ[targets({axis: angle})[differ] != theirs[differ]]
        print(f"{len(differ)} of these still do when turned by {hair:.0e} rad")


if __name__ == "__main__":
    main()
