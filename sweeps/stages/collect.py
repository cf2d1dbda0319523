"""The stages that make clouds: simulated, or recorded with the rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import pandas as pd
from cachetools import LRUCache, cached
from numpy.typing import NDArray

from lidarplace import Placement
from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Clouds, Crop, JoinedClouds, PointClouds
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.errors import MountingErrors
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.recorded import RecordedRig
from sweeps.stages.ground_truth import GroundTruth
from sweeps.stages.stage import Stage, of_type

if TYPE_CHECKING:
    from lidarplace.clouds.collect import SimulatedClouds
    from lidarplace.clouds.surroundings import Surroundings


@dataclass(frozen=True, eq=False, repr=False)
class CollectedClouds(PointClouds):
    """Clouds of one split of a part of a scene.

    `points_per_object`: of every object frame, object_id, points."""

    points_per_object: pd.DataFrame

    @classmethod
    def of(cls, log: BoxLog, clouds: PointClouds) -> CollectedClouds:
        """Count the points on the objects of the frames."""
        from lidarplace.clouds.points_in_boxes import count_points_per_object

        counts = count_points_per_object(log.boxes, clouds)
        return cls(**clouds.arrays(), points_per_object=counts)


@dataclass(frozen=True)
class CollectStage(Stage[CollectedClouds]):
    """Simulate the clouds of a split under a placement, and count the points on every object.

    `placement`: with quirks and fewer azimuth steps, if the collection has them. `crop`: lowest x,
    y, z and highest x, y, z of points that stay, metres. `seed`: of shapes, drop-off, range noise
    and mounting errors. `errors`: of the mounts. `first`, `every`: which frames of the split are
    collected; all by default. `vehicle`: carries the LiDARs; None: a sedan."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    misaligned_heights: Annotated[bool, "lidar.misaligned_heights"]
    seed: Annotated[int, "scene"]
    split: str
    crop: Annotated[Crop, "roi", "placement", "lidar"]
    errors: Annotated[MountingErrors, "mounting_errors"]
    first: int = 0
    every: int = 1
    vehicle: Annotated[Vehicle | None, "vehicle"] = None

    name = "collect"
    order = 50

    def run(self, log: BoxLog) -> CollectedClouds:
        return CollectedClouds.of(log, self.simulated(log).kept())

    def simulated(self, log: BoxLog) -> SimulatedClouds:
        """Return the clouds, each of which is simulated when it is indexed."""
        from lidarplace.clouds.collect import SimulatedClouds

        return SimulatedClouds(
            _surroundings_of(log, self.seed),
            _frames_of(log, self.split)[self.first :: self.every],
            self.placement,
            crop=self.crop,
            seed=self.seed,
            misaligned_heights=self.misaligned_heights,
            errors=self.errors,
            vehicle=self.vehicle,
        )


@cached(LRUCache(maxsize=4), key=lambda log, seed: (id(log), seed))
def _surroundings_of(log: BoxLog, seed: int) -> Surroundings:
    """Return the surroundings in a log, which keep it; successive tasks often share them."""
    from lidarplace.clouds.surroundings import Surroundings

    return Surroundings(log, seed)


@dataclass(frozen=True)
class RecordedCloudsStage(Stage[CollectedClouds]):
    """Read the clouds of a split that a rig recorded, and count the points on every object.

    `folder`, `digest`: of the clouds, and the hash of their content. `rig`: recorded them, and
    orders their points; None: that of the placement alone. `lidars`: those of it whose points are
    used."""

    folder: Annotated[Path, "placement", "scene"]
    digest: str
    split: str
    crop: Annotated[Crop, "roi", "placement", "lidar"]
    rig: RecordedRig | None = None
    lidars: Annotated[tuple[str, ...], "placement"] = ()

    name = "collect"
    order = 50

    def run(self, log: BoxLog) -> CollectedClouds:
        from lidarplace.clouds.recorded import clouds_digest, recorded_clouds

        if clouds_digest(self.folder) != self.digest:
            problem, fix = "the clouds have changed since the start", "run the command again"
            raise InputError(problem, place=self.folder, fix=fix)
        numbers = None
        if self.rig is not None:
            numbers = [n for n, name in enumerate(self.rig.names) if name in self.lidars]
        frames = _frames_of(log, self.split)
        return CollectedClouds.of(log, recorded_clouds(self.folder, frames, self.crop, numbers))


def _frames_of(log: BoxLog, split: str) -> NDArray[np.int64]:
    return log.frames.loc[log.frames["split"] == split, "frame"].to_numpy(np.int64)


def clouds_and_objects(
    inputs: Sequence[object], scenes: Sequence[int] = ()
) -> tuple[Clouds, pd.DataFrame]:
    """Join the clouds of `inputs`, and the objects in their frames.

    `scenes`: how many of the inputs each scene has, whose frames are numbered on from those of the
    scene before; by default all inputs are of one scene."""
    remaining = iter(inputs)
    clouds: list[CollectedClouds] = []
    objects: list[pd.DataFrame] = []
    first = 0
    for count in scenes or (len(inputs),):
        of_scene = tuple(islice(remaining, count))
        numbered = [
            replace(cloud, frames=cloud.frames + first)
            for cloud in of_type(CollectedClouds, of_scene)
        ]
        frames = JoinedClouds[PointClouds](numbered).frames
        truths = [truth.objects for truth in of_type(GroundTruth, of_scene)]
        truth = pd.concat(truths, ignore_index=True)
        truth["frame"] += first
        objects.append(truth[truth["frame"].isin(frames)])
        clouds += numbered
        first = 1 + int(frames.max(initial=-1))
    return JoinedClouds[PointClouds](clouds), pd.concat(objects, ignore_index=True)
