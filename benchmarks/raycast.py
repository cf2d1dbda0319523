"""Milliseconds to cast the paper's rays at 60 boxes, beside embreex.

    OMP_NUM_THREADS=1 python benchmarks/raycast.py

Casts 4 LiDARs x 16 beams x 5,625 azimuth steps = 360,000 rays of `line_roll` with the kernel of
`lidarplace.lidar.raycast` (float64, boxes, ground, own body) and with embreex (float32, triangles
of the same boxes; its ground is two more triangles). Minimum of 20 runs each, taken in turns.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from lidarplace import PAPER_PLACEMENTS
from lidarplace.lidar.raycast import OWN_BODY, cast
from lidarplace.pose import rotation

PLACEMENT = PAPER_PLACEMENTS["line_roll"]
BOXES = 60
RUNS = 20


def traffic(rng: np.random.Generator) -> NDArray[np.float64]:
    """Cars between 5 and 60 m away, rows of `lidarplace.boxes.GEOMETRY`."""
    distance, azimuth = rng.uniform(5, 60, BOXES), rng.uniform(-np.pi, np.pi, BOXES)
    return np.stack(
        [
            distance * np.cos(azimuth),
            distance * np.sin(azimuth),
            np.full(BOXES, 0.8),
            rng.uniform(3.8, 5.0, BOXES),
            rng.uniform(1.65, 2.0, BOXES),
            np.full(BOXES, 1.6),
            rng.uniform(-np.pi, np.pi, BOXES),
        ],
        axis=1,
    )


def embree(boxes: NDArray[np.float64]) -> Callable[[], None]:
    """A function that casts the same rays with embreex; scene and rays are ready before."""
    meshes = []
    for box in (OWN_BODY, *boxes):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation(0.0, 0.0, box[6]), box[:3]
        meshes.append(trimesh.creation.box(extents=box[3:6], transform=pose))
    ground = trimesh.creation.box(bounds=[[-200, -200, -1], [200, 200, 0]])
    scene = EmbreeScene()
    triangles = trimesh.util.concatenate([*meshes, ground]).triangles
    TriangleMesh(scene, triangles.astype(np.float32))
    rays = [
        (
            np.tile(mount.position, (len(PLACEMENT.lidar.directions()), 1)).astype(np.float32),
            (PLACEMENT.lidar.directions() @ mount.rotation.T).astype(np.float32),
        )
        for mount in PLACEMENT.mounts
    ]

    def run() -> None:
        for origins, directions in rays:
            scene.run(origins, directions, query="DISTANCE")

    return run


def main() -> None:
    boxes = traffic(np.random.default_rng(0))
    hits = cast(PLACEMENT.mounts[0], PLACEMENT.lidar, boxes)

    def ours() -> None:
        for mount in PLACEMENT.mounts:
            cast(mount, PLACEMENT.lidar, boxes, into=hits)

    theirs = embree(boxes)
    best = {ours: np.inf, theirs: np.inf}
    for _ in range(RUNS):
        for run in best:
            start = time.perf_counter()
            run()
            best[run] = min(best[run], time.perf_counter() - start)
    rays = len(PLACEMENT.mounts) * len(hits.range)
    print(f"{rays:,} rays, {BOXES} boxes, one core, minimum of {RUNS} runs")
    for name, run in (("lidarplace", ours), ("embreex", theirs)):
        print(f"{name:11s}{best[run] * 1e3:7.2f} ms  {rays / best[run] / 1e6:6.1f} Mrays/s")
    print(f"embreex / lidarplace: {best[theirs] / best[ours]:.1f}")


if __name__ == "__main__":
    main()
