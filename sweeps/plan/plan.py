"""From the points of a grid to tasks: a stage runs once for points that agree in what it uses."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from cachetools import cached

from lidarplace import Lidar, Placement, Roi
from lidarplace.base.errors import InputError, at
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.collect import crop_for
from lidarplace.clouds.profiles import with_tilt_in_degrees
from lidarplace.clouds.recorded import check_lidars, check_rig, clouds_digest
from lidarplace.configuration.vehicle import VehicleSettings, vehicle_of
from lidarplace.configuration.weather import WeatherSettings
from lidarplace.files.secret_urls import secret_argument
from lidarplace.logs.box_log import read_frames
from lidarplace.mounting.errors import MountingErrors, fleet
from lidarplace.mounting.random_rigs import has_other_lidar, random_rigs
from lidarplace.mounting.ring_overlap import interleaving
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.pog.surrogates.table import ASKED_OF_POG, OBJECT_SURROGATES, POG_SURROGATES
from lidarplace.requirements.layout import RequirementLayout
from lidarplace.scenes.kinds import scene_parts
from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.evaluator import EvaluatorCommand
from sweeps.configuration.file import ConfigError, reading
from sweeps.configuration.grid import GridPoint, Sweep, read_sweep
from sweeps.configuration.requirements_file import check_rig_fits, lay_out_requirements
from sweeps.configuration.sweep import Point
from sweeps.plan import named_files
from sweeps.plan.classes import boxes_by_split, check_classes, typical_of
from sweeps.plan.trial import DetectorTrial, Plan, Trial, task_label, trial_label
from sweeps.tasks import parameters
from sweeps.tasks.results import Evaluated
from sweeps.tasks.task import Task
from training.settings import PRETRAINED, TrainingSettings
from training.typical_objects import TypicalObject

ACCURACY_STEPS = (90, 360, 1440, 5760)
"""Azimuth steps at which coverage methods are compared with the exact cones."""

RECALL_FRAMES = 280
"""Frames from which surrogates of objects are; neighbours show the same objects once more."""

ACCURACY_SHARES = (0.5, 0.25)
"""Shares of the frames from which a POG is compared with that of all frames."""

ACCURACY_VOXELS = 60_000_000
"""Half the resolution is the reference if it makes no more voxels than these (about 2 GB)."""


def read_plan(path: Path, overrides: Sequence[str] = ()) -> tuple[Sweep, Plan]:
    """Read a configuration and plan its sweep. Raises ConfigError that names the file."""
    sweep = read_sweep(path, overrides)
    with at(path, ConfigError):
        return sweep, make_plan(sweep)


def make_plan(sweep: Sweep) -> Plan:
    """Tasks and trials of a sweep. Raises InputError: a checkpoint to start from, a map or
    recorded clouds are not there or do not fit; a requirement cannot be asked of the vehicle, or of
    a rig with a LiDAR inside of it; or two points of the grid are the same work."""
    builder = _Builder(sweep)
    trials = [builder.trial(grid_point) for grid_point in sweep.points]
    known: dict[str, Trial] = {}
    for trial in trials:
        if (same := known.setdefault(trial.key, trial)) is not trial:
            evaluator = trial.grid_point.point.evaluator
            seedless = isinstance(evaluator, EvaluatorCommand) and not evaluator.uses("seed")
            hint = ", or name {seed} in evaluator.command" if seedless else ""
            problem = f"'{same.label}' and '{trial.label}' are the same trial, which does not "
            problem += f"depend on {_difference(same, trial)}"
            raise InputError(problem, key="grid", fix=f"exclude one{hint}")
    laid = builder.laid(sweep.points[0].point)
    return Plan(tuple(builder.tasks.values()), tuple(trials), laid, tuple(builder.cautions))


def ignored(name: str, sensors: Sequence[object]) -> list[str]:
    """That cameras and radars are of requirements alone; nothing without any."""
    said = f"cameras and radars ({len(sensors)}) make no clouds: detectors and surrogates"
    return [f"{name}: {said} ignore them."] if sensors else []


def _difference(one: Trial, other: Trial) -> str:
    places = [{**own.axes, "promote": own.rung} for own in (one.grid_point, other.grid_point)]
    both = ((axis, value, places[1][axis]) for axis, value in places[0].items())
    return ", ".join(f"{axis} ({a} and {b})" for axis, a, b in both if a != b)


class _Builder:
    """Makes trials out of points; tasks and files that points share are there once."""

    def __init__(self, sweep: Sweep) -> None:
        self.tasks: dict[str, Task] = {}
        self._common, self._rigs = sweep.common, sweep.rigs
        self._placements = list(dict.fromkeys(g.point.placement for g in sweep.points))
        self._parts_of = cache(scene_parts)
        self._digest_of = cache(clouds_digest)
        self._check_recorded = cache(_check_recorded)
        self._checkpoint = cache(named_files.checkpoint_of)
        self._check_network = cache(named_files.check_network)
        self._curves = cache(named_files.curves_of)
        self._digests_of = cache(named_files.digests_of)
        self._laid = cache(self._lay_out)
        self._boxes_of = cache(boxes_by_split)
        by_classes = cached({}, key=lambda p: (p.scene, p.classes, *p.class_settings.items()))
        self._typical = by_classes(self._typical_of)
        self.cautions: dict[str, None] = {}
        self._random_rigs = cache(random_rigs)
        self._interleaving = cache(interleaving)
        self._simulated, self._thinned = cache(self._simulate), cache(Lidar.thinned)

    def _once(self, task: Task) -> Task:
        return self.tasks.setdefault(task.key, task)

    def trial(self, grid_point: GridPoint) -> Trial:
        point, rig = grid_point.point, grid_point.rig
        with at(key="scene"):
            parts = self._parts_of(point.scene)
        typical = self._typical(point)
        if point.detector is not None and point.training.mixed_precision == "everywhere":
            from training.device import NO_BFLOAT16, cpu_has_bfloat16, device

            if device().type == "cpu" and not cpu_has_bfloat16():
                self.cautions[NO_BFLOAT16] = None
        if (own := self._common.placements.get(point.placement)) is not None:
            self.cautions |= dict.fromkeys(ignored(point.placement, (*own.cameras, *own.radars)))
        scenes = [
            self._task("scene", grid_point, parameters.SceneParams(part.recording), (), part.name)
            for part in parts
        ]
        logs = tuple(
            scene for part, scene in zip(parts, scenes, strict=True) if "train" in part.splits
        )
        requirements = self._requirements(grid_point)
        pog = self._task(
            "pog", grid_point, parameters.PogParams(grid_point.roi, point.classes), logs
        )
        settings = point.surrogate
        scored = parameters.SurrogateParams(
            placement=rig,
            names=tuple(name for name in settings.names if name in POG_SURROGATES),
            method=settings.method,
            detection_probability=settings.detection_probability,
            occlusion=settings.occlusion,
        )
        trial = Trial(
            grid_point=grid_point,
            label=trial_label(point, grid_point.axes),
            scene_label=task_label(grid_point, scenes[0].uses),
            interleaving=self._interleaving(rig),
            scenes=tuple(scenes),
            requirements=requirements,
            pog=pog,
            surrogates=self._task("surrogates", grid_point, scored, (pog,)),
            recall=self._recall(grid_point, logs),
            **self._studies(grid_point, logs),
        )
        detector = point.detector
        return trial if detector is None else self._detected(trial, detector, parts, typical)

    def _typical_of(self, point: Point) -> tuple[TypicalObject, ...]:
        if not isinstance(point.scene, LogScene):
            return typical_of(point, None)
        boxes = self._boxes_of(point.scene)
        with reading("scene"):
            self.cautions |= dict.fromkeys(point.scene.cautions())
        self.cautions |= dict.fromkeys(check_classes(point, boxes))
        return typical_of(point, boxes)

    def _task(
        self, stage: str, grid_point: GridPoint, params: Any, inputs: tuple[Task, ...], *names: str
    ) -> Task:
        keys = parameters.keys_of(params).union(*(task.uses for task in inputs))
        return self._once(Task(stage, task_label(grid_point, keys, *names), params, inputs))

    def _recall(self, grid_point: GridPoint, logs: tuple[Task, ...]) -> Task | None:
        point = grid_point.point
        of_objects = tuple(name for name in point.surrogate.names if name in OBJECT_SURROGATES)
        if not of_objects:
            return None
        errors, draws = point.mounting_errors.errors(), point.surrogate.mount_draws
        rig = self._as_collected(point, grid_point.rig)
        params = parameters.RecallParams(
            rigs=fleet(rig, errors, draws, point.scene.seed),
            names=of_objects,
            roi=grid_point.roi,
            classes=point.classes,
            curves=self._curves(point.surrogate.curves, named_files.curve_names(point)),
            seed=point.scene.seed,
            frames=RECALL_FRAMES,
            vehicle=grid_point.vehicle,
        )
        return self._task("recall", grid_point, params, logs)

    def _studies(self, grid_point: GridPoint, logs: tuple[Task, ...]) -> dict[str, Task | None]:
        point, settings = grid_point.point, grid_point.point.surrogate
        found: dict[str, Task | None] = {"accuracy": None, "sampling_error": None}
        asked = (name for name in settings.names if name in POG_SURROGATES)
        common: dict[str, Any] = {
            "placement": grid_point.rig,
            "roi": grid_point.roi,
            "detection_probability": settings.detection_probability,
            "occlusion": settings.occlusion,
            "names": tuple(dict.fromkeys((*ASKED_OF_POG.own, *asked))),
        }
        # A sweep with rungs works them out for what goes on alone.
        chosen = spread(self._placements, settings.studied_placements)
        studied = point.placement in chosen or bool(self._common.promote)
        if studied and settings.accuracy:
            accuracy = parameters.AccuracyParams(
                **common,
                object_class=point.classes[0],
                resolutions=_resolutions(grid_point.roi),
                azimuth_steps=ACCURACY_STEPS,
                frame_shares=ACCURACY_SHARES,
            )
            found["accuracy"] = self._task("accuracy", grid_point, accuracy, logs)
        if studied and settings.sampling_error:
            common |= {"classes": point.classes, "method": settings.method}
            drawn = parameters.SamplingErrorParams(**common)
            found["sampling_error"] = self._task("sampling_error", grid_point, drawn, logs)
        return found

    def laid(self, point: Point) -> tuple[RequirementLayout, ...]:
        """What is required of the placement of a point, laid out around the vehicle."""
        return self._laid(point.surrogate.curves, point.vehicle)

    def _lay_out(
        self, curves: Path | None, body: VehicleSettings | None
    ) -> tuple[RequirementLayout, ...]:
        if not self._common.requirements:
            return ()
        known = self._curves(curves, ())
        return lay_out_requirements(self._common.requirements, vehicle_of(body), known)

    def _requirements(self, grid_point: GridPoint) -> Task | None:
        laid = self.laid(grid_point.point)
        if not laid:
            return None
        vehicle = vehicle_of(grid_point.point.vehicle)
        with at(key="requirements"):
            own = self._common.placements.get(grid_point.point.placement)
            further = () if own is None else own.further()
            check_rig_fits(grid_point.rig, vehicle, self._common.requirements, further)
        asked = tuple(own.requirement for own in laid)
        params = parameters.RequirementsParams(grid_point.rig, vehicle, asked, further)
        return self._task("requirements", grid_point, params, ())

    def _detected(
        self,
        trial: Trial,
        detector: str,
        parts: Sequence[ScenePart],
        typical: tuple[TypicalObject, ...],
    ) -> DetectorTrial:
        grid_point, scenes = trial.grid_point, trial.scenes
        point, rig = grid_point.point, grid_point.rig
        # Without the resolution, which has no part in the ground truth.
        roi, settings = point.roi, point.training
        edges = parameters.GroundTruthParams(roi.x, roi.y, roi.z, point.scene.seed)
        crop = crop_for(roi.x, roi.y, roi.z, rig, point.lidar.misaligned_heights)
        truths: dict[str, list[Task]] = {"train": [], "test": []}
        for part, scene in zip(parts, scenes, strict=True):
            truth = self._task("ground_truth", grid_point, edges, (scene,), part.name)
            for split in part.splits:
                truths[split].append(truth)

        def collected(
            split: str, rig: Placement, *names: str, first: int = 0, every: int = 1
        ) -> list[Task]:
            """Clouds of a rig in every part with frames of the split, of some of these frames."""
            params = self._collection(point, rig, split, crop, grid_point.vehicle)
            if isinstance(params, parameters.CollectParams):
                params = replace(params, first=first, every=every)
            return [
                self._task("collect", grid_point, params, (scene,), *names, part.name, split)
                for part, scene in zip(parts, scenes, strict=True)
                if split in part.splits
            ]

        test = collected("test", rig)
        detected = partial(
            DetectorTrial,
            **vars(trial),
            ground_truths=tuple(dict.fromkeys(truths["train"] + truths["test"])),
            collect_test=tuple(test),
        )
        ious = tuple(point.own_ious().items())
        evaluator = point.evaluator
        if isinstance(evaluator, EvaluatorCommand):
            if not evaluator.folder.is_dir():
                raise InputError("no such folder", key="evaluator.folder", found=evaluator.folder)
            if (name := secret_argument(shlex.split(evaluator.command))) is not None:
                text = (
                    f"evaluator.command: {name} looks like a secret, which config.yaml and MLflow "
                )
                self.cautions[f"{text}show; pass it by the environment."] = None
            name = re.sub(r"[^\w.=-]+", "-", trial.label)[:200]
            params = parameters.CommandParams(
                evaluator,
                self._digests_of(evaluator.depends_on),
                point.classes,
                point.placement if evaluator.uses("rig") else None,
                point.seed if evaluator.uses("seed") else None,
                log=self._common.output / self._common.name / "commands" / f"{name}.log",
            )
            objects = dict.fromkeys(truths["train"] + truths["test"])
            inputs = (*scenes, *collected("train", rig), *test, *objects)
            found = self._once(Task("command", trial.label, params, inputs, gpu=evaluator.gpus > 0))
            how = parameters.MeasureParams(point.classes, ious, point.metrics)
            inputs = (found, *truths["test"])
            measured = self._once(Task("measure", trial.label, how, inputs))
            return detected(finetune=None, evaluate=measured)
        if evaluator == "pretrained":
            detected = partial(detected, ground_truths=tuple(dict.fromkeys(truths["test"])))
            evaluate = self._pretrained(trial, (*test, *truths["test"]), crop)
            return detected(finetune=None, evaluate=evaluate)
        checkpoint = None
        if settings.checkpoint is not None:
            sized = (name for name, own in point.class_settings.items() if own.size is not None)
            asked = (detector, point.classes, crop, typical, frozenset(sized))
            checkpoint, typical = self._checkpoint(settings.checkpoint, settings.new_heads, *asked)
        self._check_network(detector, point.classes, crop, typical)
        network = parameters.NetworkParams(detector, point.classes, settings, crop, typical=typical)
        training = parameters.TrainingParams(
            **vars(network), seed=point.seed, checkpoint=checkpoint
        )
        before: tuple[Task, ...] = ()
        if point.evaluator != "specialist":
            before = (self._generalist(point, training, collected, truths["train"]),)
        if point.evaluator == "generalist":
            (finetune,) = before
        else:
            inputs = (*before, *collected("train", rig), *truths["train"])
            finetune = self._once(
                Task("finetune", trial.label, training, inputs, gpu=True, resumable=True)
            )
        judged = replace(network, ious=ious, metrics=point.metrics)
        inputs = (finetune, *test, *truths["test"])
        evaluate = self._once(Task("evaluate", trial.label, judged, inputs, gpu=True))
        return detected(finetune=finetune, evaluate=evaluate)

    def _pretrained(self, trial: Trial, inputs: tuple[Task, ...], crop: Crop) -> Task[Evaluated]:
        point = trial.grid_point.point
        outside = named_files.outside_of(point, self._as_collected(point, trial.grid_point.rig))
        if outside is not None:
            raise InputError(outside, key=f"placement: {point.placement!r}")
        found = named_files.generalist_of(point)
        path = point.training.checkpoint or PRETRAINED
        weights = self._once(
            Task("pretrained", path.name, parameters.PretrainedParams(found.digest, path))
        )
        # Nothing is trained: what decides trainings alone is in no key.
        of_detection = {"batch_size", "mixed_precision", "score_threshold", "nms_threshold"}
        settings = TrainingSettings().model_copy(
            update={name: getattr(point.training, name) for name in of_detection}
        )
        network = parameters.NetworkParams(found.detector, point.classes, settings, crop)
        ious = tuple(point.own_ious().items())
        params = replace(network, typical=found.typical, ious=ious, metrics=point.metrics)
        return self._once(Task("evaluate", trial.label, params, (weights, *inputs), gpu=True))

    def _generalist(
        self,
        point: Point,
        training: parameters.TrainingParams,
        collected: Callable[..., list[Task]],
        truths: Sequence[Task],
    ) -> Task:
        """The training on many rigs: every frame under some of them, every rig in some frames."""
        if point.lidar.misaligned_heights:
            problem = "lidar.misaligned_heights crops the clouds of each rig differently"
            raise InputError(problem, key="evaluator", expected="specialist", found=point.evaluator)
        settings = point.generalist
        rigs = self._training_rigs(point)
        every = -(-len(rigs) // min(settings.rigs_per_frame, len(rigs)))
        clouds = [
            task
            for number, rig in enumerate(rigs)
            for task in collected("train", rig, rig.name, first=number % every, every=every)
        ]
        longer = training.training.model_copy(update={"epochs": settings.epochs})
        label = f"generalist of {len(rigs)} rigs · {point.detector} · seed {point.seed}"
        inputs = (*clouds, *truths)
        params = parameters.PretrainParams(
            **vars(replace(training, training=longer)), scenes=(len(inputs),)
        )
        return self._once(Task("pretrain", label, params, inputs, gpu=True, resumable=True))

    def _training_rigs(self, point: Point) -> list[Placement]:
        """The rigs of a generalist: drawn with the seed of the training, or named."""
        rigs = point.generalist.rigs
        with at(key="generalist.rigs"):
            if isinstance(rigs, int):
                judged = sorted(self._placements)
                around = [self._rigs.of(point, name) for name in judged]
                return self._random_rigs(tuple(around), rigs, point.seed)
            judged = sorted(set(rigs) & set(self._placements))
            if judged:
                raise InputError(f"{judged[0]} is evaluated, so it cannot be a training rig")
            own = [self._rigs.of(point, name) for name in rigs]
            if has_other_lidar(self._rigs.of(point), own):
                problem = f"none of {', '.join(rigs)} has a LiDAR of {point.placement}"
                raise InputError(problem, fix="name rigs with the evaluated LiDAR models")
            return own

    def _collection(
        self, point: Point, placement: Placement, split: str, crop: Crop, body: Vehicle | None
    ) -> parameters.CollectParams | parameters.RecordedParams:
        """What decides clouds besides the scene: also quirks and fewer azimuth steps."""
        scene, lidar = point.scene, point.lidar
        if isinstance(scene, LogScene) and scene.clouds == "recorded":
            if lidar.tilt_in_degrees or lidar.misaligned_heights:
                raise InputError("recorded clouds have no quirks", key="lidar", fix="remove them")
            if point.mounting_errors.errors() or point.evaluator in ("generalist", "finetuned"):
                fix = "remove evaluator and mounting_errors"
                raise InputError("recorded clouds belong to one rig", key="scene.clouds", fix=fix)
            problem = "does not apply to recorded clouds"
            if point.weather != WeatherSettings():
                raise InputError(problem, key="weather", fix="remove it")
            if (share := lidar.cloud_share) != 1:
                raise InputError(problem, key="lidar.cloud_share", expected=1, found=f"{share:g}")
            names = self._rigs.recorded(point.placement)
            folder = scene.real_clouds if names else scene.folder / "clouds" / point.placement
            with reading("placement"):
                if not names:
                    check_rig(folder, placement)
                    return parameters.RecordedParams(folder, self._digest_of(folder), split, crop)
                self._check_recorded(scene, names)
                lidars = scene.rig.subset(names).names
                digest = self._digest_of(folder)
                return parameters.RecordedParams(folder, digest, split, crop, scene.rig, lidars)
        placement = self._as_collected(point, placement)
        errors, vehicle = point.mounting_errors.errors(), point.mounting_errors.vehicle
        if split == "test" and vehicle is not None:
            placement, errors = errors.drawn(placement, scene.seed, vehicle), MountingErrors()
        return parameters.CollectParams(
            placement, lidar.misaligned_heights, scene.seed, split, crop, errors, vehicle=body
        )

    def _as_collected(self, point: Point, placement: Placement) -> Placement:
        """A rig as clouds are simulated: with the quirk of its angles and fewer azimuth steps."""
        share = point.lidar.cloud_share
        with at(key=f"lidar.cloud_share: {share:g}"):
            return self._simulated(placement, point.lidar.tilt_in_degrees, share)

    def _simulate(self, placement: Placement, tilted: bool, share: float) -> Placement:
        if tilted:
            placement = with_tilt_in_degrees(placement)
        return placement.each_lidar(lambda lidar: self._thinned(lidar, share))


def _check_recorded(scene: LogScene, names: tuple[str, ...]) -> None:
    frames = read_frames(scene.folder)["frame"].to_numpy(np.int64)
    check_lidars(scene.real_clouds, scene.rig, names, frames)


def spread(names: Sequence[str], most: int) -> set[str]:
    """At most so many of `names`, evenly from the first to the last."""
    places = np.linspace(0, len(names) - 1, min(most, len(names)), dtype=int)
    return {names[place] for place in places}


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
