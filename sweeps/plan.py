"""From the points of a grid to tasks: a stage runs once for points that agree in what it uses."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from lidarplace import Placement, Roi
from lidarplace.lidar.clouds import Crop
from lidarplace.lidar.collect import crop_for
from lidarplace.lidar.profiles import with_tilt_in_degrees
from lidarplace.lidar.recorded import check_rig, clouds_digest
from lidarplace.scenes.recorded import LogScene
from sweeps.config import Point
from sweeps.config_file import ConfigError
from sweeps.grid import GridPoint, Sweep, read_sweep
from sweeps.scene_tasks import ScenePart, scene_name, scene_parts
from sweeps.task import Task

ACCURACY_STEPS = (90, 360, 1440, 5760)
"""Azimuth steps at which coverage methods are compared with the exact cones."""

FITTED_Q = tuple(float(f"{q:.2g}") for q in np.geomspace(1e-4, 1.0, 25))
"""Detection probabilities among which the one that fits measured AP best is looked for."""

ACCURACY_SHARES = (0.5, 0.25)
"""Shares of the frames from which a POG is compared with that of all frames."""

ACCURACY_VOXELS = 60_000_000
"""Half the resolution is the reference if it makes no more voxels than these (about 2 GB)."""

# Key paths of the configuration that a stage's result depends on; for its label.
_USES = {
    "scene": ("scene",),
    "ground_truth": ("scene", "roi"),
    "pog": ("scene", "roi", "surrogate.resolution", "classes"),
    "surrogates": ("placement", "scene", "roi", "lidar", "surrogate", "classes"),
    "accuracy": ("placement", "scene", "roi", "lidar", "surrogate", "classes"),
    "sampling_error": ("placement", "scene", "roi", "lidar", "surrogate", "classes"),
    "collect": ("placement", "scene", "roi", "lidar"),
}


@dataclass(frozen=True)
class Trial:
    """What becomes of one point of the grid.

    Attributes:
        grid_point: the point and its axes.
        label: "placement · detector · seed 1", and the further axes.
        scene_label: what its scene is called.
        scenes, ground_truths, collect_test: its tasks for every part of the scene, of those with
            test frames for the last.
        pog, surrogates: its cheap tasks, by which `promote` may rank.
        accuracy, sampling_error: None if they are not asked for.
        finetune, evaluate: None without a detector.
    """

    grid_point: GridPoint
    label: str
    scene_label: str
    scenes: tuple[Task, ...]
    ground_truths: tuple[Task, ...]
    collect_test: tuple[Task, ...]
    pog: Task
    surrogates: Task
    accuracy: Task | None
    sampling_error: Task | None
    finetune: Task | None
    evaluate: Task | None

    @cached_property
    def key(self) -> str:
        """Names the trial: the same for the same work under the same name of the placement."""
        last = (self.evaluate or self.pog).key
        parts = (self.grid_point.point.placement, last, self.surrogates.key)
        return hashlib.sha256("/".join(parts).encode()).hexdigest()[:12]

    @cached_property
    def results(self) -> tuple[Task, ...]:
        """The tasks whose results the trial reports."""
        further = (self.accuracy, self.sampling_error, self.finetune, self.evaluate)
        return (self.pog, self.surrogates, *filter(None, further))


@dataclass(frozen=True)
class Plan:
    """All tasks, each once and after its inputs, and the trials that they make up."""

    tasks: tuple[Task, ...]
    trials: tuple[Trial, ...]

    def needed_for(self, results: Iterable[Task]) -> list[Task]:
        """The tasks that lead to `results`, and these, in the order of the plan."""
        needed: set[str] = set()
        open_ = list(results)
        while open_:
            task = open_.pop()
            if task.key not in needed:
                needed.add(task.key)
                open_ += task.inputs
        return [task for task in self.tasks if task.key in needed]


def read_plan(path: Path, overrides: Sequence[str] = ()) -> tuple[Sweep, Plan]:
    """Read a configuration and plan its sweep. Raises ConfigError that names the file."""
    sweep = read_sweep(path, overrides)
    try:
        return sweep, make_plan(sweep)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def make_plan(sweep: Sweep) -> Plan:
    """Tasks and trials of a sweep.

    Raises:
        ConfigError: a checkpoint to start from, a map or recorded clouds are not there or do not
            fit; or two points of the grid are the same work.
    """
    builder = _Builder(sweep)
    trials = [builder.trial(grid_point) for grid_point in sweep.points]
    labels: dict[str, str] = {}
    for trial in trials:
        if trial.key in labels:
            raise ConfigError(
                f"grid: '{labels[trial.key]}' and '{trial.label}' are the same work; exclude one"
            )
        labels[trial.key] = trial.label
    return Plan(tuple(builder.tasks.values()), tuple(trials))


class _Builder:
    """Makes trials out of points; tasks and files that points share are there once."""

    def __init__(self, sweep: Sweep) -> None:
        self.tasks: dict[str, Task] = {}
        self._common = sweep.common
        self._parts_of = cache(scene_parts)
        self._digest_of = cache(clouds_digest)
        self._checkpoint_digest = cache(_checkpoint_digest)

    def _once(self, task: Task) -> Task:
        return self.tasks.setdefault(task.key, task)

    def trial(self, grid_point: GridPoint) -> Trial:
        """The trial of a point, with all its tasks."""
        point = grid_point.point
        names = {stage: _label(stage, point, grid_point.axes) for stage in _USES}
        placement = self._common.placement_named(point.placement, point.lidar.lidar())
        try:
            parts = self._parts_of(point.scene)
        except ValueError as error:
            raise ConfigError(f"scene: {error}") from None
        scenes = [
            self._once(Task("scene", _join(names["scene"], part.name), part.params))
            for part in parts
        ]
        for_pog = tuple(
            scene for part, scene in zip(parts, scenes, strict=True) if "train" in part.splits
        )
        label = _trial_label(point, grid_point.axes)
        return Trial(
            grid_point=grid_point,
            label=label,
            scene_label=names["scene"],
            scenes=tuple(scenes),
            **self._surrogates(point, placement, names, for_pog),
            **self._detection(point, placement, names, label, parts, scenes),
        )

    def _surrogates(
        self, point: Point, placement: Placement, names: Mapping[str, str], logs: tuple[Task, ...]
    ) -> dict[str, Any]:
        """Tasks that need boxes alone."""
        roi, settings = asdict(point.voxel_roi()), point.surrogate
        pog = self._once(Task("pog", names["pog"], {"roi": roi, "classes": point.classes}, logs))
        own = settings.model_dump(mode="json", exclude={"resolution", "accuracy", "sampling_error"})
        params = _rig(placement) | own | {"fitted_q": FITTED_Q}
        found: dict[str, Any] = {
            "pog": pog,
            "surrogates": self._once(Task("surrogates", names["surrogates"], params, (pog,))),
            "accuracy": None,
            "sampling_error": None,
        }
        studied = _rig(placement) | {
            "roi": roi,
            "detection_probability": settings.detection_probability,
            "occlusion": settings.occlusion,
        }
        if settings.accuracy:
            params = studied | {
                "object_class": point.classes[0],
                "resolutions": _resolutions(point.voxel_roi()),
                "azimuth_steps": ACCURACY_STEPS,
                "frame_shares": ACCURACY_SHARES,
            }
            found["accuracy"] = self._once(Task("accuracy", names["accuracy"], params, logs))
        if settings.sampling_error:
            params = studied | {"classes": point.classes, "method": settings.method}
            found["sampling_error"] = self._once(
                Task("sampling_error", names["sampling_error"], params, logs)
            )
        return found

    def _detection(
        self,
        point: Point,
        placement: Placement,
        names: Mapping[str, str],
        label: str,
        parts: Sequence[ScenePart],
        scenes: Sequence[Task],
    ) -> dict[str, Any]:
        """Tasks that a detector needs."""
        if point.detector is None:
            return {"ground_truths": (), "collect_test": (), "finetune": None, "evaluate": None}
        # Without the resolution, which has no part in the ground truth.
        edges = point.roi.model_dump(mode="json") | {"seed": point.scene.seed}
        crop = crop_for(
            point.roi.x, point.roi.y, point.roi.z, placement, point.lidar.misaligned_heights
        )
        clouds: dict[str, list[Task]] = {"train": [], "test": []}
        truths: dict[str, list[Task]] = {"train": [], "test": []}
        for part, scene in zip(parts, scenes, strict=True):
            name = _join(names["ground_truth"], part.name)
            truth = self._once(Task("ground_truth", name, edges, (scene,)))
            for split in part.splits:
                name = _join(names["collect"], part.name, split)
                params = _collection(point, placement, self._digest_of)
                params |= {"split": split, "crop": crop}
                clouds[split].append(self._once(Task("collect", name, params, (scene,))))
                truths[split].append(truth)
        training = point.training
        network = {
            "detector": point.detector,
            "classes": point.classes,
            "training": training.model_dump(mode="json"),
            "point_range": crop,
        }
        checkpoint = training.checkpoint and self._checkpoint_digest(
            training.checkpoint, training.new_heads, point.detector, point.classes, crop
        )
        finetune = Task(
            "finetune",
            label,
            network | {"seed": point.seed, "checkpoint": checkpoint},
            (*clouds["train"], *truths["train"]),
            gpu=True,
            resumable=True,
        )
        finetune = self._once(finetune)
        inputs = (finetune, *clouds["test"], *truths["test"])
        return {
            "ground_truths": tuple(dict.fromkeys(truths["train"] + truths["test"])),
            "collect_test": tuple(clouds["test"]),
            "finetune": finetune,
            "evaluate": self._once(Task("evaluate", label, network, inputs, gpu=True)),
        }


def _rig(placement: Placement) -> dict[str, Any]:
    return {
        "mounts": [astuple(mount) for mount in placement.mounts],
        "lidars": [asdict(lidar) for lidar in placement.lidars],
    }


def _collection(
    point: Point, placement: Placement, digest_of: Callable[[Path], str]
) -> dict[str, Any]:
    """What decides clouds besides the scene.

    Quirks and fewer azimuth steps are of the collection, not of the rig.
    """
    scene = point.scene
    if isinstance(scene, LogScene) and scene.clouds == "recorded":
        if point.lidar.tilt_in_degrees or point.lidar.misaligned_heights:
            raise ConfigError("lidar: recorded clouds are as they are; leave the quirks out")
        if point.lidar.cloud_share != 1:
            raise ConfigError(
                f"lidar.cloud_share: recorded clouds are as they are; allowed is 1, found "
                f"{point.lidar.cloud_share:g}"
            )
        folder = scene.folder / "clouds" / point.placement
        try:
            check_rig(folder, placement)
            return {"recorded": str(folder), "digest": digest_of(folder)}
        except (OSError, ValueError) as error:
            raise ConfigError(f"placement: {error}") from None
    if point.lidar.tilt_in_degrees:
        placement = with_tilt_in_degrees(placement)
    share = point.lidar.cloud_share
    try:
        placement = placement.with_lidar([lidar.thinned(share) for lidar in placement.lidars])
    except ValueError as error:
        raise ConfigError(f"lidar.cloud_share: {share:g}: {error}") from None
    return _rig(placement) | {
        "recorded": None,
        "seed": scene.seed,
        "misaligned_heights": point.lidar.misaligned_heights,
    }


def further_axes(sweep: Sweep) -> tuple[str, ...]:
    """Axes of the grid besides placement, detector and seed."""
    return tuple(axis for axis in sweep.axes if axis not in ("placement", "detector", "seed"))


def _resolutions(roi: Roi) -> tuple[float, ...]:
    """Half and twice the resolution, where they divide the ROI and half of it is affordable."""
    found = []
    for resolution in (roi.resolution / 2, roi.resolution * 2):
        try:
            other = replace(roi, resolution=resolution)
        except ValueError:  # does not divide it
            continue
        if math.prod(other.shape) <= ACCURACY_VOXELS:
            found.append(resolution)
    return tuple(found)


def _join(*names: str) -> str:
    return " · ".join(filter(None, names))


def _label(stage: str, point: Point, axes: Mapping[str, Any]) -> str:
    uses = _USES[stage]
    parts = [point.placement] if "placement" in uses else []
    parts += [
        f"{axis}={value}"
        for axis, value in axes.items()
        if axis != "placement" and any(axis == u or axis.startswith(f"{u}.") for u in uses)
    ]
    return " · ".join(parts) or scene_name(point.scene)


def _trial_label(point: Point, axes: Mapping[str, Any]) -> str:
    further = [
        f"{axis}={value}"
        for axis, value in axes.items()
        if axis not in ("placement", "detector", "seed")
    ]
    detected = [point.detector, f"seed {point.seed}"] if point.detector else []
    return " · ".join([point.placement, *detected, *further])


def _checkpoint_digest(
    path: Path, new_heads: bool, detector: str, classes: Sequence[str], point_range: Crop
) -> str:
    """SHA-256 of a checkpoint that fits; better told now than after hours of scenes."""
    from training import build_detector  # torch, which a sweep from scratch need not wait for
    from training.checkpoints import load_checkpoint

    try:
        model = build_detector(detector, classes, point_range=point_range)
        return load_checkpoint(model, path, new_heads).digest
    except OSError as error:
        raise ConfigError(f"training.checkpoint: {path}: {error.strerror}") from None
    except ValueError as error:
        raise ConfigError(f"training.checkpoint: {error}") from None
