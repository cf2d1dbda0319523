"""The tasks of a point that need no detector: POG, surrogates, requirements and studies."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lidarplace import Roi
from lidarplace.base.errors import at
from lidarplace.configuration.vehicle import VehicleSettings, vehicle_of
from lidarplace.mounting.errors import fleet
from lidarplace.pog.surrogates.table import ASKED_OF_POG, OBJECT_SURROGATES, POG_SURROGATES
from lidarplace.requirements.layout import RequirementLayout
from lidarplace.scenes.kinds import Scene, poles_at
from lidarplace.scenes.site import Site
from sweeps.configuration.grid import GridPoint
from sweeps.configuration.requirements_file import check_rig_fits, lay_out_requirements
from sweeps.plan import named_files
from sweeps.plan.clouds import as_collected
from sweeps.plan.planning import Planning
from sweeps.stages.accuracy import AccuracyStage
from sweeps.stages.pog import PogStage
from sweeps.stages.recall import RecallStage
from sweeps.stages.requirements import RequirementsStage
from sweeps.stages.sampling_error import SamplingErrorStage
from sweeps.stages.surrogates import SurrogatesStage
from sweeps.stages.task import Task

RECALL_FRAMES = 280
"""Frames from which surrogates of objects are; neighbours show the same objects once more."""

ACCURACY_STEPS = (90, 360, 1440, 5760)
"""Azimuth steps at which coverage methods are compared with the exact cones."""

ACCURACY_SHARES = (0.5, 0.25)
"""Shares of the frames from which a POG is compared with that of all frames."""

ACCURACY_VOXELS = 60_000_000
"""Half the resolution is the reference if it makes no more voxels than these (about 2 GB)."""


def plan_surrogates(
    planning: Planning, grid_point: GridPoint, pog: Task[PogStage]
) -> Task[SurrogatesStage]:
    """Add the surrogates of a POG."""
    settings = grid_point.point.surrogate
    stage = SurrogatesStage(
        placement=grid_point.rig,
        names=tuple(name for name in settings.names if name in POG_SURROGATES),
        method=settings.method,
        detection_probability=settings.detection_probability,
        occlusion=settings.occlusion,
        roi=grid_point.roi,
    )
    return planning.add_for(grid_point, stage, [pog])


def plan_recall(
    planning: Planning, grid_point: GridPoint, logs: Sequence[Task]
) -> Task[RecallStage] | None:
    """Add the surrogates of objects; None if the configuration names none."""
    point = grid_point.point
    names = tuple(name for name in point.surrogate.names if name in OBJECT_SURROGATES)
    if not names:
        return None
    errors, draws = point.mounting_errors.errors(), point.surrogate.mount_draws
    rig = as_collected(planning, point, grid_point.rig)
    curves, classes = point.surrogate.curves, named_files.curve_names(point)
    stage = RecallStage(
        rigs=fleet(rig, errors, draws, point.scene.seed),
        names=names,
        roi=grid_point.roi,
        classes=point.classes,
        curves=planning.once(named_files.curves_of, curves, classes),
        seed=point.scene.seed,
        frames=RECALL_FRAMES,
        vehicle=grid_point.vehicle,
    )
    return planning.add_for(grid_point, stage, logs)


def layout_of(planning: Planning, grid_point: GridPoint) -> tuple[RequirementLayout, ...]:
    """Return the requirements of the sweep, laid out around the vehicle of a point."""
    point = grid_point.point
    scene = None if point.site is None else point.scene
    curves = point.surrogate.curves
    return planning.once(_lay_out, planning, curves, point.vehicle, point.site, scene)


def _lay_out(
    planning: Planning,
    curves: Path | None,
    vehicle: VehicleSettings | None,
    site: Site | None,
    scene: Scene | None,
) -> tuple[RequirementLayout, ...]:
    requirements = planning.sweep.common.requirements
    if not requirements:
        return ()
    known_curves = planning.once(named_files.curves_of, curves, ())
    carrier = vehicle_of(vehicle)
    if site is not None and scene is not None:
        carrier = poles_at(scene, site, carrier).with_walls
    return lay_out_requirements(requirements, carrier, known_curves)


def plan_requirements(planning: Planning, grid_point: GridPoint) -> Task[RequirementsStage] | None:
    """Add the check of requirements; None without any."""
    layout, common = layout_of(planning, grid_point), planning.sweep.common
    if not layout:
        return None
    vehicle = layout[0].vehicle
    with at(key="requirements"):
        settings = common.placements.get(grid_point.point.placement)
        further = () if settings is None else settings.further()
        check_rig_fits(grid_point.rig, vehicle, common.requirements, further)
    requirements = tuple(item.requirement for item in layout)
    stage = RequirementsStage(grid_point.rig, vehicle, requirements, further)
    return planning.add_for(grid_point, stage)


Study = Callable[[Planning, GridPoint, Sequence[Task]], Task | None]
"""Plans a task on the logs of a scene that a trial reports; None: the point does not name it."""


def plan_accuracy(
    planning: Planning, grid_point: GridPoint, logs: Sequence[Task]
) -> Task[AccuracyStage] | None:
    """Add the study of error against run time, for some placements."""
    settings = grid_point.point.surrogate
    if not (settings.accuracy and _is_studied(planning, grid_point)):
        return None
    stage = AccuracyStage(
        placement=grid_point.rig,
        roi=grid_point.roi,
        detection_probability=settings.detection_probability,
        occlusion=settings.occlusion,
        object_class=grid_point.point.classes[0],
        names=_studied_surrogates(grid_point),
        resolutions=_resolutions(grid_point.roi),
        azimuth_steps=ACCURACY_STEPS,
        frame_shares=ACCURACY_SHARES,
    )
    return planning.add_for(grid_point, stage, logs)


def plan_sampling_error(
    planning: Planning, grid_point: GridPoint, logs: Sequence[Task]
) -> Task[SamplingErrorStage] | None:
    """Add the study of how surrogates depend on the choice of frames, for some placements."""
    settings = grid_point.point.surrogate
    if not (settings.sampling_error and _is_studied(planning, grid_point)):
        return None
    stage = SamplingErrorStage(
        placement=grid_point.rig,
        roi=grid_point.roi,
        detection_probability=settings.detection_probability,
        occlusion=settings.occlusion,
        names=_studied_surrogates(grid_point),
        classes=grid_point.point.classes,
        method=settings.method,
    )
    return planning.add_for(grid_point, stage, logs)


STUDIES: tuple[Study, ...] = (plan_accuracy, plan_sampling_error)
"""The studies of a sweep: a further stage that a trial reports is a line."""


def _is_studied(planning: Planning, grid_point: GridPoint) -> bool:
    """Whether the placement is among those studied; with rungs, whatever is promoted is."""
    most = grid_point.point.surrogate.studied_placements
    studied = planning.once(_studied_placements, planning, most)
    return grid_point.point.placement in studied or bool(planning.sweep.common.promote)


def _studied_placements(planning: Planning, most: int) -> set[str]:
    """Select at most `most` placements, evenly from the first to the last."""
    names = planning.placements
    places = np.linspace(0, len(names) - 1, min(most, len(names)), dtype=int)
    return {names[place] for place in places}


def _studied_surrogates(grid_point: GridPoint) -> tuple[str, ...]:
    named = (name for name in grid_point.point.surrogate.names if name in POG_SURROGATES)
    return tuple(dict.fromkeys((*ASKED_OF_POG.own, *named)))


def _resolutions(roi: Roi) -> tuple[float, ...]:
    """Return half and twice the resolution, where they divide the ROI and half is affordable."""
    resolutions = []
    for resolution in (roi.resolution / 2, roi.resolution * 2):
        try:
            other = replace(roi, resolution=resolution)
        except ValueError:  # does not divide it
            continue
        if math.prod(other.shape) <= ACCURACY_VOXELS:
            resolutions.append(resolution)
    return tuple(resolutions)
