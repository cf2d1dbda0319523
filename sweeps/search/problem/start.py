"""Rigs that a search begins with, in the slots of its space."""

import itertools
from collections.abc import Mapping

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.placement import MountSettings
from lidarplace.configuration.sensor import SensorSettings
from sweeps.configuration.rigs import Rigs
from sweeps.configuration.search import SearchFile
from sweeps.search.problem.rig import MountedLidar
from sweeps.search.problem.slots import Assignment
from sweeps.search.problem.space import Space, assign_to_slots
from tracking.run_folders.search_json import UNNAMED


def start_of(file: SearchFile, rigs: Rigs, name: str, space: Space) -> list[Assignment]:
    """Assign a placement to the slots; LiDARs without a model get the first of their zones."""
    settings = file.placements.get(name)
    with at(key=f"search.start: {name}"):
        if settings is not None and settings.recorded:
            raise InputError("has recorded LiDARs", fix="give it mounts")
        written = settings.mounts if settings is not None else ()
        mounts = itertools.zip_longest(rigs.of(file, name).mounts, written)
        fixed = {(lidar.mount.x, lidar.mount.y, lidar.mount.z) for lidar in space.fixed}
        lidars = [
            MountedLidar("" if lidar is None else _model_of(file, number, lidar), "", mount)
            for number, (mount, lidar) in enumerate(mounts, start=1)
            if (mount.x, mount.y, mount.z) not in fixed
        ]
        return assign_to_slots(space, lidars)


def _model_of(file: SearchFile, number: int, mount: MountSettings) -> str:
    """Return the name of the model that a mount has; "" for a mount without a LiDAR."""
    if mount.lidar is None:
        return ""
    losses = file.lidar.losses
    models: Mapping[str, SensorSettings] = file.search.models or {UNNAMED: file.lidar}
    lidar = mount.lidar.lidar(losses)
    name = next((name for name, model in models.items() if model.lidar(losses) == lidar), None)
    if name is None:
        problem = f"LiDAR {number} is none of search.models"
        raise InputError(problem, expected=f"one of {', '.join(models)}")
    return name
