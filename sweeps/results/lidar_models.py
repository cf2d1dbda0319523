"""Which LiDARs the rigs of a sweep carry, as its pages tell of them."""

import numpy as np

from lidarplace.rigs.catalogue.datasheet import datasheet
from lidarplace.rigs.placement import Placement
from sweeps.configuration.grid import Sweep
from sweeps.configuration.sweep import Point
from tracking.run_folders.sweep_json import LidarModel


def lidar_models(sweep: Sweep) -> dict[str, tuple[LidarModel, ...]]:
    """The model of every mount, by the placement's name; none where an axis varies it."""
    if any(axis.partition(".")[0] == "lidar" for axis in sweep.axes):
        return {}
    points = {own.point.placement: own for own in sweep.points}
    return {name: _models(sweep, own.point, own.rig) for name, own in points.items()}


def _models(sweep: Sweep, point: Point, rig: Placement) -> tuple[LidarModel, ...]:
    settings = sweep.common.placements.get(point.placement)
    if settings is None:
        own = [point.lidar.name] * len(rig.mounts)
    elif settings.recorded:  # by their beams alone
        own = [None] * len(rig.mounts)
    else:
        own = [(mount.lidar or point.lidar).name for mount in settings.mounts]
    models = []
    for name, lidar in zip(own, rig.lidars, strict=True):
        low, high = np.degrees([min(lidar.elevations), max(lidar.elevations)]).round(9)
        models.append(
            LidarModel(
                name=name,
                price_usd=datasheet(name).price_usd if name else None,
                beams=lidar.beams,
                elevation_deg=(low, high),
                azimuth_steps=lidar.azimuth_steps,
            )
        )
    return tuple(models)
