"""From the points of a grid to tasks: a stage runs once for points that agree in what it uses."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from cachetools import cached

from lidarplace import Placement, Roi
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.collect import crop_for
from lidarplace.clouds.profiles import with_tilt_in_degrees
from lidarplace.clouds.recorded import check_rig, clouds_digest
from lidarplace.configuration.vehicle import VehicleSettings, vehicle_of
from lidarplace.configuration.weather import WeatherSettings
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.errors import MountingErrors
from lidarplace.mounting.random_rigs import has_other_lidar, random_rigs
from lidarplace.mounting.ring_overlap import Interleaving, interleaving
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.pog.surrogates.sampling_error import SamplingError
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, POG_SURROGATES
from lidarplace.recall.detection_curve import IOU, DetectionCurves, default_curves, read_curves
from lidarplace.requirements.layout import Laid
from lidarplace.scenes.kinds import scene_parts
from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import GridPoint, Sweep, read_sweep
from sweeps.configuration.question import check_asked, laid_out
from sweeps.configuration.sweep import Point
from sweeps.plan.classes import boxes_by_split, check_classes, typical_of
from sweeps.tasks.parameters import (
    AccuracyParams,
    CollectParams,
    GroundTruthParams,
    NetworkParams,
    PogParams,
    RecallParams,
    RecordedParams,
    RequirementsParams,
    SamplingErrorParams,
    SceneParams,
    SurrogateParams,
    TrainingParams,
    keys_of,
)
from sweeps.tasks.results import (
    Accuracy,
    Collected,
    Evaluated,
    GroundTruth,
    Pog,
    PogScores,
    Required,
    Scores,
    Trained,
)
from sweeps.tasks.task import Task
from training.typical_objects import TypicalObject, from_plain

ACCURACY_STEPS = (90, 360, 1440, 5760)
"""Azimuth steps at which coverage methods are compared with the exact cones."""

FITTED_Q = tuple(float(f"{q:.2g}") for q in np.geomspace(1e-4, 1.0, 25))
"""Detection probabilities among which the one that fits measured AP best is looked for."""

RECALL_FRAMES = 280
"""Frames from which surrogates of objects are; neighbours show the same objects once more."""

ACCURACY_SHARES = (0.5, 0.25)
"""Shares of the frames from which a POG is compared with that of all frames."""

ACCURACY_VOXELS = 60_000_000
"""Half the resolution is the reference if it makes no more voxels than these (about 2 GB)."""


@dataclass(frozen=True)
class Trial:
    """What becomes of one point of the grid.

    Attributes:
        grid_point: the point and its axes.
        label: "placement · detector · seed 1", and the further axes.
        scene_label: what its scene is called.
        vehicle: carries the LiDARs; None: a sedan.
        scenes, ground_truths, collect_test: its tasks for every part of the scene, of those with
            test frames for the last.
        pog, surrogates, recall: its cheap tasks, by which `promote` may rank; recall is None if no
            surrogate of objects is asked for.
        requirements: what becomes of them; None if there are none.
        accuracy, sampling_error: None if they are not asked for, or of other placements.
        finetune, evaluate: the training whose weights tell of the placement, which is shared where
            a generalist does; None without a detector.
        interleaving: how its rings would lie between each other, where they coincide.
        evaluate_interleaved: of that rig, where a generalist judges.
    """

    grid_point: GridPoint
    label: str
    scene_label: str
    vehicle: Vehicle | None
    scenes: tuple[Task[BoxLog], ...]
    ground_truths: tuple[Task[GroundTruth], ...]
    collect_test: tuple[Task[Collected], ...]
    pog: Task[Pog]
    surrogates: Task[PogScores]
    recall: Task[Scores] | None
    requirements: Task[Required] | None
    accuracy: Task[Accuracy] | None
    sampling_error: Task[SamplingError] | None
    finetune: Task[Trained] | None
    evaluate: Task[Evaluated] | None
    interleaving: Interleaving | None
    evaluate_interleaved: Task[Evaluated] | None

    @cached_property
    def key(self) -> str:
        """Names the trial: the same for the same work under the same name of the placement."""
        last = (self.evaluate or self.pog).key
        found = (*self.scores, *filter(None, [self.requirements]))
        parts = (self.grid_point.point.placement, last, *(task.key for task in found))
        return hashlib.sha256("/".join(parts).encode()).hexdigest()[:12]

    @property
    def scores(self) -> tuple[Task[Scores], ...]:
        """The tasks whose results have tables of surrogates."""
        return (self.surrogates,) if self.recall is None else (self.surrogates, self.recall)

    def score_by(self, surrogate: str) -> Task[Scores]:
        """The one of `scores` that has a surrogate."""
        return self.scores[-1] if surrogate in OBJECT_SURROGATES else self.surrogates

    @cached_property
    def results(self) -> tuple[Task, ...]:
        """The tasks whose results the trial reports."""
        detected = (self.finetune, self.evaluate, self.evaluate_interleaved)
        further = (self.requirements, self.accuracy, self.sampling_error, *detected)
        return (self.pog, *self.scores, *filter(None, further))


@dataclass(frozen=True)
class Plan:
    """All tasks, each once and after its inputs, and the trials that they make up.

    Attributes:
        laid: what is required, around the vehicle; by the curves of the first trial.
        cautions: what is to be known of the classes of the logs, a sentence each.
    """

    tasks: tuple[Task, ...]
    trials: tuple[Trial, ...]
    laid: tuple[Laid, ...] = ()
    cautions: tuple[str, ...] = ()

    @property
    def typical(self) -> tuple[TypicalObject, ...]:
        """Objects of which anchors are, of classes that have not the preset's; each once."""
        params = (t.params for t in self.tasks if isinstance(t.params, NetworkParams))
        return tuple(dict.fromkeys(item for own in params for item in own.typical))

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
            fit; a requirement cannot be asked of the vehicle, or of a rig with a LiDAR inside of
            it; or two points of the grid are the same work.
    """
    builder = _Builder(sweep)
    trials = [builder.trial(grid_point) for grid_point in sweep.points]
    known: dict[str, Trial] = {}
    for trial in trials:
        same = known.setdefault(trial.key, trial)
        if same is not trial:
            raise ConfigError(
                f"grid: '{same.label}' and '{trial.label}' are the same work, which does not "
                f"depend on {_difference(same, trial)}; exclude one"
            )
    laid = builder.laid(sweep.points[0].point)
    return Plan(tuple(builder.tasks.values()), tuple(trials), laid, tuple(builder.cautions))


def _difference(one: Trial, other: Trial) -> str:
    """The axes on which two trials differ, or the rungs, with both values."""
    places = [{**own.axes, "promote": own.rung} for own in (one.grid_point, other.grid_point)]
    return ", ".join(
        f"{axis} ({value} and {places[1][axis]})"
        for axis, value in places[0].items()
        if value != places[1][axis]
    )


class _Builder:
    """Makes trials out of points; tasks and files that points share are there once."""

    def __init__(self, sweep: Sweep) -> None:
        self.tasks: dict[str, Task] = {}
        self._common = sweep.common
        self._placements = list(dict.fromkeys(g.point.placement for g in sweep.points))
        self._parts_of = cache(scene_parts)
        self._digest_of = cache(clouds_digest)
        self._checkpoint = cache(_checkpoint)
        self._curves = cache(_curves)
        self._laid = cache(self._lay_out)
        self._boxes_of = cache(boxes_by_split)
        self._typical = cached({}, key=_classes_of)(self._typical_of)
        self.cautions: dict[str, None] = {}
        self._random_rigs = cache(random_rigs)
        self._interleaving = cache(interleaving)

    def _once(self, task: Task) -> Task:
        return self.tasks.setdefault(task.key, task)

    def trial(self, grid_point: GridPoint) -> Trial:
        """The trial of a point, with all its tasks."""
        point, rig = grid_point.point, grid_point.rig
        try:
            parts = self._parts_of(point.scene)
        except ValueError as error:
            raise ConfigError(f"scene: {error}") from None
        typical = self._typical(point)
        scenes = [
            self._task("scene", grid_point, SceneParams(part.recording), (), part.name)
            for part in parts
        ]
        for_pog = tuple(
            scene for part, scene in zip(parts, scenes, strict=True) if "train" in part.splits
        )
        return Trial(
            grid_point=grid_point,
            label=_trial_label(point, grid_point.axes),
            scene_label=_label(grid_point, scenes[0].uses),
            vehicle=point.body(),
            interleaving=self._interleaving(rig),
            scenes=tuple(scenes),
            requirements=self._requirements(grid_point, rig),
            **self._surrogates(grid_point, rig, for_pog),
            **self._detection(grid_point, rig, parts, scenes, typical),
        )

    def _typical_of(self, point: Point) -> tuple[TypicalObject, ...]:
        """Of the classes whose anchors are not the preset's; refuses a class that is not there."""
        if not isinstance(point.scene, LogScene):
            return typical_of(point, None)
        boxes = self._boxes_of(point.scene)
        self.cautions |= dict.fromkeys(check_classes(point, boxes))
        return typical_of(point, boxes)

    def _task(
        self, stage: str, grid_point: GridPoint, params: Any, inputs: tuple[Task, ...], *names: str
    ) -> Task:
        """A task named after what makes a difference to it, and after `names`."""
        keys = keys_of(params).union(*(task.uses for task in inputs))
        return self._once(Task(stage, _join(_label(grid_point, keys), *names), params, inputs))

    def _surrogates(
        self, grid_point: GridPoint, rig: Placement, logs: tuple[Task, ...]
    ) -> dict[str, Any]:
        """Tasks that need boxes alone."""
        point, roi = grid_point.point, grid_point.point.voxel_roi()
        settings, placement = point.surrogate, _nameless(rig)
        pog = self._task("pog", grid_point, PogParams(roi, point.classes), logs)
        params = SurrogateParams(
            placement=placement,
            names=tuple(name for name in settings.names if name in POG_SURROGATES),
            method=settings.method,
            detection_probability=settings.detection_probability,
            occlusion=settings.occlusion,
            fitted_q=FITTED_Q,
        )
        found: dict[str, Any] = {
            "pog": pog,
            "surrogates": self._task("surrogates", grid_point, params, (pog,)),
            "recall": None,
            "accuracy": None,
            "sampling_error": None,
        }
        of_objects = tuple(name for name in settings.names if name in OBJECT_SURROGATES)
        if of_objects:
            seen = RecallParams(
                placement=_nameless(self._as_collected(point, rig)),
                names=of_objects,
                roi=roi,
                classes=point.classes,
                curves=self._curves(settings.curves, _curve_names(point)),
                seed=point.scene.seed,
                frames=RECALL_FRAMES,
                vehicle=point.body(),
            )
            found["recall"] = self._task("recall", grid_point, seen, logs)
        chosen = spread(self._placements, settings.studied_placements)
        # A sweep with rungs works them out for what goes on alone.
        if point.placement not in chosen and not self._common.promote:
            return found
        if settings.accuracy:
            studied = AccuracyParams(
                placement=placement,
                roi=roi,
                detection_probability=settings.detection_probability,
                occlusion=settings.occlusion,
                object_class=point.classes[0],
                resolutions=_resolutions(roi),
                azimuth_steps=ACCURACY_STEPS,
                frame_shares=ACCURACY_SHARES,
            )
            found["accuracy"] = self._task("accuracy", grid_point, studied, logs)
        if settings.sampling_error:
            drawn = SamplingErrorParams(
                placement=placement,
                roi=roi,
                detection_probability=settings.detection_probability,
                occlusion=settings.occlusion,
                classes=point.classes,
                method=settings.method,
            )
            found["sampling_error"] = self._task("sampling_error", grid_point, drawn, logs)
        return found

    def laid(self, point: Point) -> tuple[Laid, ...]:
        """What is required of the placement of a point, laid out around the vehicle."""
        return self._laid(point.surrogate.curves, point.vehicle)

    def _lay_out(self, curves: Path | None, body: VehicleSettings | None) -> tuple[Laid, ...]:
        if not self._common.requirements:
            return ()
        known = self._curves(curves, ())
        return laid_out(self._common.requirements, vehicle_of(body), known, "")

    def _requirements(self, grid_point: GridPoint, rig: Placement) -> Task | None:
        laid = self.laid(grid_point.point)
        if not laid:
            return None
        vehicle = vehicle_of(grid_point.point.vehicle)
        try:
            check_asked(rig, vehicle, self._common.requirements)
        except ValueError as error:
            raise ConfigError(f"requirements: {error}") from None
        asked = tuple(own.requirement for own in laid)
        params = RequirementsParams(_nameless(rig), vehicle, asked)
        return self._task("requirements", grid_point, params, ())

    def _detection(
        self,
        grid_point: GridPoint,
        rig: Placement,
        parts: Sequence[ScenePart],
        scenes: Sequence[Task],
        typical: tuple[TypicalObject, ...],
    ) -> dict[str, Any]:
        """Tasks that a detector needs."""
        point = grid_point.point
        if point.detector is None:
            return {
                "ground_truths": (),
                "collect_test": (),
                "finetune": None,
                "evaluate": None,
                "evaluate_interleaved": None,
            }
        # Without the resolution, which has no part in the ground truth.
        roi, settings = point.roi, point.training
        edges = GroundTruthParams(roi.x, roi.y, roi.z, point.scene.seed)
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
            params = self._collection(point, rig, split, crop)
            if isinstance(params, CollectParams):
                params = replace(params, first=first, every=every)
            return [
                self._task("collect", grid_point, params, (scene,), *names, part.name, split)
                for part, scene in zip(parts, scenes, strict=True)
                if split in part.splits
            ]

        test = collected("test", rig)
        checkpoint = None
        if settings.checkpoint is not None:
            checkpoint, typical = self._checkpoint(
                settings.checkpoint,
                settings.new_heads,
                point.detector,
                point.classes,
                crop,
                typical,
                frozenset(n for n, own in point.class_settings.items() if own.size is not None),
            )
        network = NetworkParams(point.detector, point.classes, settings, crop, typical=typical)
        training = TrainingParams(**vars(network), seed=point.seed, checkpoint=checkpoint)
        label = _trial_label(point, grid_point.axes)
        before: tuple[Task, ...] = ()
        if point.judge != "specialist":
            before = (self._generalist(point, training, collected, truths["train"]),)
        if point.judge == "generalist":
            (finetune,) = before
        else:
            inputs = (*before, *collected("train", rig), *truths["train"])
            finetune = self._once(
                Task("finetune", label, training, inputs, gpu=True, resumable=True)
            )
        judged = replace(network, ious=tuple(point.own_ious().items()))
        pitched = None
        better = self._interleaving(rig) if point.judge == "generalist" else None
        if better is not None:
            inputs = (finetune, *collected("test", better.placement, "pitched"), *truths["test"])
            name = f"{label} · pitched"
            pitched = self._once(Task("evaluate", name, judged, inputs, gpu=True))
        inputs = (finetune, *test, *truths["test"])
        return {
            "ground_truths": tuple(dict.fromkeys(truths["train"] + truths["test"])),
            "collect_test": tuple(test),
            "finetune": finetune,
            "evaluate": self._once(Task("evaluate", label, judged, inputs, gpu=True)),
            "evaluate_interleaved": pitched,
        }

    def _generalist(
        self,
        point: Point,
        training: TrainingParams,
        collected: Callable[..., list[Task]],
        truths: Sequence[Task],
    ) -> Task:
        """The training on many rigs: every frame under some of them, every rig in some frames."""
        if point.lidar.misaligned_heights:
            raise ConfigError(
                f"judge: {point.judge}: lidar.misaligned_heights crops the clouds of each rig "
                "otherwise; allowed is specialist"
            )
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
        params = replace(training, training=longer)
        inputs = (*clouds, *truths)
        return self._once(Task("pretrain", label, params, inputs, gpu=True, resumable=True))

    def _training_rigs(self, point: Point) -> list[Placement]:
        """The rigs of a generalist: drawn with the seed of the training, or named."""
        common, rigs = self._common, point.generalist.rigs
        try:
            if isinstance(rigs, int):
                judged = sorted(self._placements)
                around = [common.rig_named(name, point) for name in judged]
                return self._random_rigs(tuple(around), rigs, point.seed)
            judged = sorted(set(rigs) & set(self._placements))
            if judged:
                raise ValueError(f"{judged[0]} is judged, so it cannot be trained on")
            named = [common.rig_named(name, point) for name in rigs]
            if has_other_lidar(common.rig_named(point.placement, point), named):
                raise ValueError(
                    f"none of {', '.join(rigs)} has a LiDAR of {point.placement}: name rigs of the "
                    "models that are judged"
                )
            return named
        except ValueError as error:
            raise ConfigError(f"generalist.rigs: {error}") from None

    def _collection(
        self, point: Point, placement: Placement, split: str, crop: Crop
    ) -> CollectParams | RecordedParams:
        """What decides clouds besides the scene.

        Quirks and fewer azimuth steps are of the collection, not of the rig.
        """
        scene, lidar = point.scene, point.lidar
        if isinstance(scene, LogScene) and scene.clouds == "recorded":
            if lidar.tilt_in_degrees or lidar.misaligned_heights:
                raise ConfigError("lidar: recorded clouds are as they are; leave the quirks out")
            if point.mounting_errors.errors() or point.judge != "specialist":
                raise ConfigError(
                    "scene.clouds: recorded clouds are of one rig as it was; leave out judge and "
                    "mounting_errors"
                )
            if point.weather != WeatherSettings():
                raise ConfigError("weather: recorded clouds are as they are; leave it out")
            if lidar.cloud_share != 1:
                raise ConfigError(
                    f"lidar.cloud_share: recorded clouds are as they are; allowed is 1, found "
                    f"{lidar.cloud_share:g}"
                )
            folder = scene.folder / "clouds" / point.placement
            try:
                check_rig(folder, placement)
                return RecordedParams(folder, self._digest_of(folder), split, crop)
            except (OSError, ValueError) as error:
                raise ConfigError(f"placement: {error}") from None
        placement = _nameless(self._as_collected(point, placement))
        errors, vehicle = point.mounting_errors.errors(), point.mounting_errors.vehicle
        if split == "test" and vehicle is not None:
            placement, errors = errors.drawn(placement, scene.seed, vehicle), MountingErrors()
        return CollectParams(
            placement,
            lidar.misaligned_heights,
            scene.seed,
            split,
            crop,
            errors,
            vehicle=point.body(),
        )

    def _as_collected(self, point: Point, placement: Placement) -> Placement:
        """A rig as clouds are simulated: with the quirk of its angles and fewer azimuth steps."""
        if point.lidar.tilt_in_degrees:
            placement = with_tilt_in_degrees(placement)
        share = point.lidar.cloud_share
        try:
            return placement.with_lidar([own.thinned(share) for own in placement.lidars])
        except ValueError as error:
            raise ConfigError(f"lidar.cloud_share: {share:g}: {error}") from None


def _classes_of(point: Point) -> tuple[Any, ...]:
    """What decides the typical objects of a point."""
    return point.scene, point.classes, tuple(point.class_settings.items())


def _nameless(placement: Placement) -> Placement:
    """The same rig for all names, so that a rig of two names is computed once."""
    return replace(placement, name="placement")


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


def _join(*names: str) -> str:
    return " · ".join(filter(None, names))


def _label(grid_point: GridPoint, keys: Collection[str]) -> str:
    """The placement and the axes among `keys` of the configuration, or the scene."""
    parts = [grid_point.point.placement] if "placement" in keys else []
    parts += [
        f"{axis}={value}"
        for axis, value in grid_point.axes.items()
        if axis != "placement" and any(_overlap(axis, key) for key in keys)
    ]
    return " · ".join(parts) or grid_point.point.scene.name


def _overlap(one: str, other: str) -> bool:
    """Whether a key path is the other, or above or below it."""
    return one == other or one.startswith(f"{other}.") or other.startswith(f"{one}.")


def _trial_label(point: Point, axes: Mapping[str, Any]) -> str:
    further = [
        f"{axis}={value}"
        for axis, value in axes.items()
        if axis not in ("placement", "detector", "seed")
    ]
    detected = [point.detector, f"seed {point.seed}"] if point.detector else []
    return " · ".join([point.placement, *detected, *further])


def _curve_names(point: Point) -> tuple[tuple[str, str | None], ...]:
    """The classes that need a detection curve, each with the one whose curve it may take."""
    if "expected_recall" not in point.surrogate.names:
        return ()
    own = point.class_settings
    return tuple((name, own[name].curve if name in own else None) for name in point.classes)


def _curves(path: Path | None, classes: Sequence[tuple[str, str | None]]) -> DetectionCurves:
    """Detection curves, with one for each of `classes`: its own, or that of another."""
    try:
        curves = default_curves() if path is None else read_curves(path)
        for name, other in classes:
            if other is not None and not curves.has(name, IOU):
                curves = curves.lent(other, name, IOU)
            if not curves.has(name, IOU):
                known = ", ".join(curve.object_class for curve in curves.curves if curve.iou == IOU)
                raise ValueError(
                    f"expected_recall has no detection curve of {name} at IoU {IOU:g}, only of "
                    f"{known}; leave expected_recall out of surrogate.names, say whose curve it "
                    f"takes with class_settings.{name}.curve, or make its own with python -m "
                    "sweeps.commands.calibrate"
                )
    except OSError as error:
        raise ConfigError(f"surrogate.curves: {path}: {error.strerror}") from None
    except ValueError as error:
        raise ConfigError(f"surrogate.curves: {error}") from None
    return curves


def _checkpoint(
    path: Path,
    new_heads: bool,
    detector: str,
    classes: Sequence[str],
    point_range: Crop,
    typical: tuple[TypicalObject, ...],
    fixed: frozenset[str],
) -> tuple[str, tuple[TypicalObject, ...]]:
    """SHA-256 of a checkpoint that fits; better told now than after hours of scenes.

    And the typical objects of the classes: those of the checkpoint, unless `new_heads` are trained,
    before those of the data. Sizes of the configuration, of the classes `fixed`, stay.
    """
    from training import build_detector  # torch, which a sweep from scratch need not wait for
    from training.checkpoints import load_checkpoint, read_checkpoint

    try:
        known = {item.name: item for item in typical}
        if not new_heads:
            kept = from_plain(read_checkpoint(path)[0])
            known |= {t.name: t for t in kept if t.name in classes and t.name not in fixed}
        typical = tuple(known[name] for name in classes if name in known)
        model = build_detector(detector, classes, point_range=point_range, typical=typical)
        return load_checkpoint(model, path, new_heads).digest, typical
    except OSError as error:
        raise ConfigError(f"training.checkpoint: {path}: {error.strerror}") from None
    except ValueError as error:
        raise ConfigError(f"training.checkpoint: {error}") from None
