"""CPU seconds to convert recorded clouds into a static world, and to cast against it.

    python benchmarks/static_world.py

A vehicle with two VLP-32C drives 10 m/s, at 10 Hz, along a street of buildings, trees, poles and
parked cars without a label; 20 cars have one. About 100,000 points a frame are written as Parquet,
and `lidarplace convert table --clouds --world` reads them. Then the upper LiDAR is cast in
the same frames against buildings as boxes, and against the world that was built: all rays, and only
those that meet an object. CPU time, medians of casts in turns; the first run compiles the kernels,
and is not counted.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from typer.testing import CliRunner

from lidarplace import Lidar, Mount, Placement
from lidarplace.clouds.collect import collect
from lidarplace.clouds.raycast import cast
from lidarplace.clouds.static_world import stop_in_world
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.commands.convert import app
from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import BUILDING_COLUMNS, GEOMETRY

RATE_HZ, SPEED = 10.0, 10.0
AROUND = (-120.0, -120.0, -5.0, 120.0, 120.0, 30.0)
RIG = Placement(
    "two", [Mount(0.0, 0.0, 1.9), Mount(0.0, 0.0, 1.7, roll=np.pi)], Lidar.named("vlp32c")
)
MOUNTS = (
    "mounts: [{name: up, z: 1.9, lidar: {name: vlp32c}}, "
    "{name: down, z: 1.7, roll_deg: 180, lidar: {name: vlp32c}}]"
)


def drive(frames: int, seed: int = 0) -> BoxLog:
    """A street along x with buildings and traffic, all in the world's axes of its only scene."""
    rng = np.random.default_rng(seed)
    end = frames / RATE_HZ * SPEED + 120
    still = []
    for side in (-1, 1):
        for x in np.arange(-120, end, 14):
            still.append((x, side * 16, 6, 12, 8, 12, rng.normal(0, 0.02)))
        for x in np.arange(-120, end, 9):
            still.append((x, side * 9, 2, 0.3, 0.3, 4, 0.0))
            still.append((x, side * 9, 5, *rng.uniform(2, 4, 3), 0.0))
            still.append((x + 4, side * 6.5, 0.75, 4.4, 1.8, 1.5, 0.0))
    rows = []
    for n in range(frames):
        at = n / RATE_HZ * SPEED
        for k in range(20):
            x, y = 12.0 * k - 100 + 0.5 * n, (-2.5, 2.5)[k % 2]
            rows.append(("a", n, n / RATE_HZ, str(k), "Car", x - at, y, 0.75, 4.4, 1.8, 1.5, 0.0))
    names = ["scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY]
    number = np.arange(frames)
    table = pd.DataFrame({"scene": "a", "frame": number, "timestamp_s": number / RATE_HZ})
    table = table.assign(route=0, split="train", ego_x=number / RATE_HZ * SPEED)
    buildings = pd.DataFrame([("a", *row) for row in still], columns=list(BUILDING_COLUMNS))
    log = BoxLog(pd.DataFrame(rows, columns=names), table.assign(ego_y=0.0, ego_yaw=0.0))
    return replace(log, buildings=buildings)


def convert(log: BoxLog, folder: Path) -> tuple[BoxLog, float, float]:
    """The log with the world of its simulated clouds, CPU seconds, and points of a frame."""
    frames = log.frames["frame"].to_numpy()
    clouds = collect(log, frames, RIG, AROUND)
    (folder / "clouds").mkdir(parents=True)
    for n in range(len(frames)):
        table = pd.DataFrame(clouds[n][:, :4], columns=["x", "y", "z", "intensity"])
        table.assign(lidar=clouds.lidar(n)).to_parquet(folder / "clouds" / f"{frames[n]}.parquet")
    write_box_log(folder / "source", replace(log, buildings=log.buildings.iloc[:0]))
    (folder / "rig.yaml").write_text(MOUNTS)
    own = [f"{folder}/{name}" for name in ("source", "log", "rig.yaml", "clouds")]
    start = time.process_time()
    told = ["table", *own[:2], "--rig", own[2], "--clouds", own[3], "--world"]
    done = CliRunner().invoke(app, told)
    seconds = time.process_time() - start
    if done.exit_code:
        sys.exit(done.output)
    return read_box_log(folder / "log"), seconds, float(clouds.counts.sum() / len(frames))


def casts(log: BoxLog, built: BoxLog, frames: list[int]) -> dict[str, float]:
    """Median CPU milliseconds of a cast of the upper LiDAR."""
    mount, lidar = RIG.mounts[0], RIG.lidars[0]
    old, new = Surroundings(log), Surroundings(built)
    seconds: dict[str, list[float]] = {}
    for frame in frames:
        boxes, objects, world = old.parts(frame, 120.0), new.parts(frame, 120.0), new.world(frame)
        ways = {
            "buildings": (boxes, None, False),
            "world": (objects, world, False),
            "world, rays on objects": (objects, world, True),
        }
        for name, (parts, around, only) in ways.items():
            start = time.process_time()
            hits = cast(mount, lidar, parts, level=around is None)
            if around is not None:
                stop_in_world(mount, lidar, hits, around, only_objects=only)
            seconds.setdefault(name, []).append(time.process_time() - start)
    return {name: 1000 * float(np.median(own[1:])) for name, own in seconds.items()}


def main(frames: int = 100) -> None:
    with tempfile.TemporaryDirectory() as folder:
        convert(drive(3), Path(folder) / "first")
        log = drive(frames)
        built, seconds, points = convert(log, Path(folder) / "drive")
        world = (Path(folder) / "drive" / "log" / "world.npz").stat().st_size
    hour = 3600 * RATE_HZ / frames
    print(f"{points:,.0f} points a frame, {len(built.world['a'].keys):,} cells")
    print(f"convert --clouds --world: {1000 * seconds / frames:.0f} ms of CPU a frame,")
    print(f"  an hour of driving: {seconds * hour / 60:.0f} min of CPU,")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"  a world of {world * hour / 1e9:.2f} GB on disk; {memory:.1f} GiB of memory at most")
    found = casts(log, built, list(range(0, frames, 5)))
    for name, milliseconds in found.items():
        print(f"cast at {name}: {milliseconds:.1f} ms")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
