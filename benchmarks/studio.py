"""How fast the studio's page follows a hand: from a move to the message at the socket.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 .venv/bin/python benchmarks/studio.py

One LiDAR of four is dragged in a frame of simulated traffic with about 20 objects. A client in
another process reads what is sent and draws nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from websockets.asyncio.server import ServerConnection

from lidarplace.rigs.lidar import Lidar
from lidarplace.studio.log_frames import scene_of, simulated_traffic
from lidarplace.studio.page.page import Page
from lidarplace.studio.page.rig_nodes import quaternion
from lidarplace.studio.page.server import serving
from lidarplace.studio.rigs_file import read_rigs
from lidarplace.studio.studio import Studio

CLIENT = """
import sys, viser
from websockets.sync.client import connect
address, origin = sys.argv[1:]
protocol = f"viser-v{viser.__version__}"
with connect(address, origin=origin, subprotocols=[protocol], max_size=None) as server:
    for _ in server:
        pass
"""
CLOUD_BYTES = 50_000
"""A message of more has points in it."""
TOWN_OBJECTS = 20


class Sent:
    """When messages are handed to the socket, and how large they are."""

    def __init__(self) -> None:
        self.times: list[tuple[float, int]] = []
        self.came = threading.Condition()
        send = ServerConnection.send

        async def noted(connection, message, *rest, **more):
            with self.came:
                self.times.append((time.perf_counter(), len(message)))
                self.came.notify_all()
            await send(connection, message, *rest, **more)

        ServerConnection.send = noted

    def after(self, start: float, bytes_: int) -> float:
        """Seconds from `start` to the first message of so many bytes."""

        def found() -> list[float]:
            return [at for at, size in self.times if at > start and size >= bytes_]

        with self.came:
            self.came.wait_for(found)
            return found()[0] - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--moves", type=int, default=200)
    parser.add_argument("--lidars", type=int, default=4)
    parser.add_argument("--beams", type=int, default=16)
    parser.add_argument("--azimuth-steps", type=int, default=Lidar.paper().azimuth_steps)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rigs.yaml"
        sides = np.linspace(-0.6, 0.6, arguments.lidars).round(3).tolist()
        mounts = ", ".join(f"{{x: 0, y: {y}, z: 2.2}}" for y in sides)
        path.write_text(
            f"lidar: {{beams: {arguments.beams}, azimuth_steps: {arguments.azimuth_steps}}}\n"
            f"placements: {{mine: {{mounts: [{mounts}]}}}}\nconstraints: {{distance: 0.05}}\n"
        )
        measure(Studio(read_rigs(path), simulated_traffic()), arguments.moves)


def measure(studio: Studio, moves: int) -> None:
    counts = studio.log.boxes.groupby("frame").size()
    studio.show_frame(int((counts - TOWN_OBJECTS).abs().idxmin()))
    sent = Sent()
    with serving(None, "benchmark") as (server, address):
        where = [address.replace("http", "ws"), address.rpartition("/")[0]]
        client = subprocess.Popen([sys.executable, "-c", CLIENT, *where])
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        page = Page(studio, server, scene_of(None))
        sent.after(0.0, CLOUD_BYTES)
        time.sleep(2.0)
        random = np.random.default_rng(0)
        numbers, clouds = [], []
        for move in range(-5, moves):
            target = SimpleNamespace(
                position=np.array([0.0, -0.6, 2.2]) + random.uniform(-0.3, 0.3, 3),
                wxyz=quaternion(studio.rig.mounts[0]),
            )
            event = SimpleNamespace(phase="update", target=target)
            start = time.perf_counter()
            asyncio.run_coroutine_threadsafe(page._pulled(event), server.get_event_loop())
            first, cloud = sent.after(start, 0), sent.after(start, CLOUD_BYTES)
            time.sleep(0.1)  # what is drawn after the cloud
            if move >= 0:  # the first compile
                numbers.append(first)
                clouds.append(cloud)
        page.close()
        client.kill()
        client.wait()
    placement = studio.placement
    assert placement is not None
    print(f"{len(placement.mounts)} LiDARs of {placement.lidars[0]!r}, {moves} moves, one core")
    for what, seconds in (("numbers", numbers), ("cloud", clouds)):
        middle, most = 1e3 * np.quantile(seconds, [0.5, 0.95])
        print(f"{what:8} median {middle:5.1f} ms, 95th percentile {most:5.1f} ms")


if __name__ == "__main__":
    main()
