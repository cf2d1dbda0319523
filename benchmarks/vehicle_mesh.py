"""What a vehicle's mesh costs: its tree, the rays of a LiDAR, the near field and the mounts inside.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/vehicle_mesh.py

An ellipsoid of 4.6 by 1.9 by 1.5 m in ever more triangles under the paper's LiDAR and rig;
milliseconds, the second of two calls, as the first compiles.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Roi
from lidarplace.clouds.shade import ends_of
from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.housing import NO_HOUSINGS
from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import Vehicle, depth_in_body

HEAD = ("triangles", "tree", "rays", "body_share", "inside", "near field")
NEAR = Roi((-4, 4), (-2.6, 2.6), (0, 1), 0.2)


def second(call: Callable[[], Any]) -> float:
    """Milliseconds of the second call."""
    call()
    start = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - start)


def times(vehicle: Vehicle, mesh: Mesh) -> list[float]:
    """Of what a mesh is used for, in the order of `HEAD`."""
    lidar, mount, rig = Lidar.paper(), Mount(0.3, 0.4, 1.7), PAPER_PLACEMENTS["line"]
    places = np.array([own.position for own in rig.mounts])
    return [
        second(lambda: Mesh(mesh.vertices, mesh.faces).tree),
        second(lambda: ends_of(mount, lidar, NO_HOUSINGS, vehicle)),
        second(lambda: body_share(mount, lidar, vehicle)),
        second(lambda: depth_in_body(vehicle, places)),
        second(lambda: seen_in_columns(rig, vehicle, NEAR)),
    ]


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    print("".join(f"{name:>11}" for name in HEAD))
    for subdivisions in (3, 5, 7):
        ball = trimesh.creation.icosphere(subdivisions=subdivisions)
        mesh = Mesh(ball.vertices * [2.3, 0.95, 0.75] + [0, 0, 0.76], ball.faces)
        vehicle = Vehicle("ball", np.empty((0, 2, 3)), mesh)
        print(f"{len(mesh.faces):11,}", *(f"{ms:10.1f}" for ms in times(vehicle, mesh)))


if __name__ == "__main__":
    main()
