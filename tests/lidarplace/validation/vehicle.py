"""A made-up vehicle whose LiDARs lose returns by a rule that the validation has to find again."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from lidarplace.clouds.clouds import PointClouds, as_kept, write_clouds
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.validation.simulation import SECTORS, rays_on_objects, sectors_of

NAMES = ("up", "down")
LIDAR = Lidar.even(beams=32, elevation_deg=(-25, 12), azimuth_steps=1200, range=150.0)
RIG = RecordedRig(NAMES, Placement("vehicle", [Mount(z=2.1), Mount(z=1.8, yaw=0.3)], LIDAR))
SIZES = {"Car": (4.5, 1.9, 1.6), "Cyclist": (1.8, 0.6, 1.7), "Pedestrian": (0.7, 0.7, 1.75)}
KEPT = (-150.0, -150.0, -20.0, 150.0, 150.0, 40.0)


class Loss(NamedTuple):
    """What the vehicle loses."""

    factor: dict[str, float]
    distance: float = np.inf
    shadow: float = 1.0  # share that the lower LiDAR returns in its first six sectors


NOTHING = Loss({})
REAL = Loss({"Car": 0.6, "Cyclist": 0.45, "Pedestrian": 0.8}, distance=75.0, shadow=0.05)


def boxes(routes: int, objects: int, frames: int, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Objects that stand around a vehicle, on ground that is not flat."""
    random = np.random.default_rng(seed)
    rows, listed = [], []
    for route in range(routes):
        names = random.choice(list(SIZES), objects, p=[0.5, 0.25, 0.25])
        turn = (np.arange(objects) + random.uniform(0, 0.5, objects)) / objects * 2 * np.pi
        away, yaw = random.uniform(8, 70, objects), random.uniform(-3, 3, objects)
        ground = random.uniform(-2, 2, objects) * away / 70
        for index in range(frames):
            frame = route * frames + index
            listed.append((f"drive{route}", frame, 0.1 * index, route, "test"))
            for n, name in enumerate(names):
                length, width, height = SIZES[name]
                at = away[n] * np.cos(turn[n] + 0.01 * index), away[n] * np.sin(turn[n])
                rows.append((f"drive{route}", frame, 0.1 * index, f"{route}-{n}", name, *at,
                             ground[n] + height / 2, length, width, height, yaw[n]))  # fmt: skip
    columns = ["scene", "frame", "timestamp_s", "route", "split"]
    return pd.DataFrame(rows, columns=list(BOX_COLUMNS)), pd.DataFrame(listed, columns=columns)


def recorded(
    folder: Path, loss: Loss, routes: int = 4, objects: int = 16, frames: int = 3, seed: int = 1
) -> BoxLog:
    """A log with the points that the vehicle's LiDARs returned, and its clouds in `folder`."""
    table, listed = boxes(routes, objects, frames, seed)
    log = BoxLog(table, listed)
    surroundings, mask = Surroundings(log), np.ones((2, SECTORS))
    mask[1, :6] = loss.shadow
    factor = np.array([loss.factor.get(name, 1.0) for name in table["class"]])
    counts = {name: np.zeros(len(table)) for name in NAMES}
    for scene, of_scene in listed.groupby("scene"):
        clouds = []
        for frame in of_scene["frame"]:
            random = np.random.default_rng(int(frame))
            rows, points, sizes = surroundings.rows(frame), [], []
            parts = body_parts(None).and_(surroundings.parts(frame, 300.0))
            for n, mount in enumerate(RIG.placement.mounts):
                hits = rays_on_objects(mount, LIDAR, parts)
                met = np.zeros(LIDAR.rays, bool)
                met[hits.ray] = True
                away, target = np.full(LIDAR.rays, 80.0), np.zeros(LIDAR.rays, int)
                away[hits.ray], target[hits.ray] = hits.range, hits.target  # the rest is walls
                at = mount.position + LIDAR.directions() @ mount.rotation.T * away[:, None]
                share = mask[n][sectors_of(LIDAR.directions())]
                own_share = factor[rows][target]
                share = share * np.where(met, own_share * np.exp(-away / loss.distance), 1.0)
                returns = random.random(len(at)) < share
                counts[NAMES[n]][rows] = np.bincount(target[returns & met], minlength=len(rows))
                seen = np.c_[at[returns], np.full(returns.sum(), 0.5)].astype(np.float32)
                points.append(as_kept(seen[np.abs(seen[:, 2]) < 19], KEPT))
                sizes.append(len(points[-1]))
            clouds.append((np.concatenate(points), np.array(sizes)))
        packed = PointClouds.from_frames(of_scene["frame"].to_numpy(), clouds, KEPT)
        write_clouds(folder / "clouds" / "recorded" / scene, packed)
    of_each = {f"points/{name}": values for name, values in counts.items()}
    table = table.assign(points=sum(counts.values()), **of_each)
    log = BoxLog(table, listed, rigs=dict.fromkeys(listed["scene"].unique(), RIG))
    write_box_log(folder, log)
    return log
