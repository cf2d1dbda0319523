"""The clouds and the ground truth of a point, in every part of its scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lidarplace import Lidar, Placement
from lidarplace.base.errors import InputError, at
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.collect import crop_for
from lidarplace.clouds.profiles import with_tilt_in_degrees
from lidarplace.clouds.recorded import check_lidars, check_rig, clouds_digest
from lidarplace.configuration.weather import WeatherSettings
from lidarplace.logs.box_log import read_frames
from lidarplace.logs.motion import motion_in
from lidarplace.mounting.errors import MountingErrors
from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.recorded import LogScene, log_parts
from sweeps.configuration.file import reading
from sweeps.configuration.grid import GridPoint
from sweeps.configuration.point import Point
from sweeps.plan.planning import Planning
from sweeps.plan.trial import CloudTask
from sweeps.stages.collect import CollectStage, RecordedCloudsStage
from sweeps.stages.ground_truth import GroundTruthStage
from sweeps.stages.scene import SceneStage
from sweeps.stages.task import Task


@dataclass(frozen=True)
class TrialClouds:
    """Plans the clouds and the ground truth of a point, whose scene has `parts`."""

    planning: Planning
    grid_point: GridPoint
    parts: Sequence[ScenePart]
    scenes: Sequence[Task[SceneStage]]

    @cached_property
    def crop(self) -> Crop:
        """Lowest x, y, z and highest x, y, z of the points of the rig."""
        point, roi = self.grid_point.point, self.grid_point.point.roi
        rig, misaligned_heights = self.grid_point.rig, point.lidar.misaligned_heights
        return crop_for(roi.x, roi.y, roi.z, rig, misaligned_heights)

    @cached_property
    def truths(self) -> dict[str, list[Task[GroundTruthStage]]]:
        """Ground truth of every part, by the splits that the part has frames of."""
        # Without the resolution, which has no part in the ground truth.
        point, roi = self.grid_point.point, self.grid_point.point.roi
        stage = GroundTruthStage(roi.x, roi.y, roi.z, point.scene.seed)
        truths: dict[str, list[Task[GroundTruthStage]]] = {"train": [], "test": []}
        for part, scene in zip(self.parts, self.scenes, strict=True):
            truth = self.planning.add_for(self.grid_point, stage, [scene], part.name)
            for split in part.splits:
                truths[split].append(truth)
        return truths

    def collect(
        self, split: str, rig: Placement | None = None, *names: str, first: int = 0, every: int = 1
    ) -> list[CloudTask]:
        """Add the clouds of a rig in every part with frames of the split.

        By default of the rig of the point. `first`, `every`: which of these frames are simulated.
        """
        rig = self.grid_point.rig if rig is None else rig
        stage = self._collection(rig, split)
        if isinstance(stage, CollectStage):
            stage = replace(stage, first=first, every=every)
        return [
            self.planning.add_for(self.grid_point, stage, [scene], *names, part.name, split)
            for part, scene in zip(self.parts, self.scenes, strict=True)
            if split in part.splits
        ]

    def _collection(self, rig: Placement, split: str) -> CollectStage | RecordedCloudsStage:
        """Return the stage that makes clouds: with quirks and fewer azimuth steps, or recorded."""
        point, crop = self.grid_point.point, self.crop
        scene, lidar = point.scene, point.lidar
        if isinstance(scene, LogScene) and scene.clouds == "recorded":
            _check_unchanged(point)
            return self._recorded(scene, rig, split, crop)
        rig = as_collected(self.planning, point, rig)
        if rig.takes_time and isinstance(scene, LogScene):
            self.planning.once(_check_motion, scene)
        errors, vehicle = point.mounting_errors.errors(), point.mounting_errors.vehicle
        if split == "test" and vehicle is not None:
            rig, errors = errors.drawn(rig, scene.seed, vehicle), MountingErrors()
        return CollectStage(
            rig,
            lidar.misaligned_heights,
            scene.seed,
            split,
            crop,
            errors,
            vehicle=self.grid_point.vehicle,
        )

    def _recorded(
        self, scene: LogScene, rig: Placement, split: str, crop: Crop
    ) -> RecordedCloudsStage:
        placement, once = self.grid_point.point.placement, self.planning.once
        names = self.planning.sweep.rigs.recorded(placement)
        folder = scene.real_clouds if names else scene.folder / "clouds" / placement
        with reading("placement"):
            if not names:
                check_rig(folder, rig)
                return RecordedCloudsStage(folder, once(clouds_digest, folder), split, crop)
            once(_check_recorded, scene, names)
            lidars = scene.rig.subset(names).names
            digest = once(clouds_digest, folder)
            return RecordedCloudsStage(folder, digest, split, crop, scene.rig, lidars)


def as_collected(planning: Planning, point: Point, rig: Placement) -> Placement:
    """Return a rig as clouds are simulated: with the quirk of its angles, fewer azimuth steps."""
    share = point.lidar.cloud_share
    with at(key=f"lidar.cloud_share: {share:g}"):
        return planning.once(_collected, planning, rig, point.lidar.tilt_in_degrees, share)


def _collected(planning: Planning, rig: Placement, tilted: bool, share: float) -> Placement:
    if tilted:
        rig = with_tilt_in_degrees(rig)
    return rig.each_lidar(lambda lidar: planning.once(Lidar.thinned, lidar, share))


def _check_unchanged(point: Point) -> None:
    """Refuse settings that change how clouds are simulated, as these are recorded."""
    lidar = point.lidar
    if lidar.tilt_in_degrees or lidar.misaligned_heights:
        raise InputError("recorded clouds have no quirks", key="lidar", fix="remove them")
    if point.mounting_errors.errors() or point.evaluator in ("generalist", "finetuned"):
        fix = "remove evaluator and mounting_errors"
        raise InputError("recorded clouds belong to one rig", key="scene.clouds", fix=fix)
    problem = "does not apply to recorded clouds"
    if point.weather != WeatherSettings():
        raise InputError(problem, key="weather", fix="remove it")
    if lidar.rate_hz is not None:
        raise InputError(problem, key="lidar.rate_hz", fix="remove it")
    if (share := lidar.cloud_share) != 1:
        raise InputError(problem, key="lidar.cloud_share", expected=1, found=f"{share:g}")


def _check_motion(scene: LogScene) -> None:
    """Check that the logs of a scene show motion, as LiDARs with rate_hz need it."""
    for part in log_parts(scene):
        with reading("scene.test_folder" if part.name else "scene.folder"):
            motion_in(part.recording.record())


def _check_recorded(scene: LogScene, names: tuple[str, ...]) -> None:
    frames = read_frames(scene.folder)["frame"].to_numpy(np.int64)
    check_lidars(scene.real_clouds, scene.rig, names, frames)
