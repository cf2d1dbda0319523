"""The plan of a sweep: a stage runs once for points that agree in what it uses."""

from collections.abc import Callable, Sequence
from pathlib import Path

from lidarplace.base.errors import InputError, at
from lidarplace.base.plugin_folders import plugin_folder
from lidarplace.mounting.ring_overlap import interleaving
from lidarplace.scenes.kinds import scene_parts
from sweeps.configuration.evaluator import EvaluatorCommand
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import GridPoint, Sweep, read_sweep
from sweeps.configuration.point import Point
from sweeps.plan.classes import typical_objects_of
from sweeps.plan.clouds import TrialClouds
from sweeps.plan.command import plan_command
from sweeps.plan.generalist import plan_finetuned, plan_generalist
from sweeps.plan.labels import task_label, trial_label
from sweeps.plan.planning import Planning
from sweeps.plan.pretrained import plan_pretrained
from sweeps.plan.specialist import plan_specialist
from sweeps.plan.surrogates import (
    STUDIES,
    layout_of,
    plan_recall,
    plan_requirements,
    plan_surrogates,
)
from sweeps.plan.trial import DetectorTrial, Plan, Trial
from sweeps.stages.pog import PogStage
from sweeps.stages.scene import SceneStage
from training.typical_objects import TypicalObject

Evaluator = Callable[[Trial, TrialClouds, tuple[TypicalObject, ...]], DetectorTrial]
"""Function that adds the tasks of an evaluation to a trial.

The last argument: typical objects of the classes without anchors.
"""

_EVALUATORS: dict[str, Evaluator] = {
    "specialist": plan_specialist,
    "generalist": plan_generalist,
    "finetuned": plan_finetuned,
    "pretrained": plan_pretrained,
}


def read_plan(path: Path, overrides: Sequence[str] = ()) -> tuple[Sweep, Plan]:
    """Read a configuration and plan its sweep. Raises ConfigError that names the file."""
    sweep = read_sweep(path, overrides)
    with at(path, ConfigError), plugin_folder(path.parent):
        return sweep, make_plan(sweep)


def make_plan(sweep: Sweep) -> Plan:
    """Plan the tasks and trials of a sweep.

    Raises InputError: a checkpoint to start from, a map or recorded clouds do not exist or do not
    fit; a requirement cannot be checked for the vehicle, or for a rig with a LiDAR inside of it; or
    two points of the grid are the same work."""
    planning = Planning(sweep)
    trials = [_plan_trial(planning, grid_point) for grid_point in sweep.points]
    by_key: dict[str, Trial] = {}
    for trial in trials:
        if (same := by_key.setdefault(trial.key, trial)) is not trial:
            raise _same_trial(same, trial)
    layout = layout_of(planning, sweep.points[0])
    return Plan(tuple(planning.tasks.values()), tuple(trials), layout, tuple(planning.cautions))


def _same_trial(one: Trial, other: Trial) -> InputError:
    evaluator = other.grid_point.point.evaluator
    seedless = isinstance(evaluator, EvaluatorCommand) and not evaluator.uses("seed")
    hint = ", or name {seed} in evaluator.command" if seedless else ""
    places = [{**t.grid_point.axes, "promote": t.grid_point.rung} for t in (one, other)]
    both = ((axis, value, places[1][axis]) for axis, value in places[0].items())
    difference = ", ".join(f"{axis} ({a} and {b})" for axis, a, b in both if a != b)
    problem = f"'{one.label}' and '{other.label}' are the same trial, which does not "
    problem += f"depend on {difference}"
    return InputError(problem, key="grid", fix=f"exclude one{hint}")


def _plan_trial(planning: Planning, grid_point: GridPoint) -> Trial:
    point = grid_point.point
    with at(key="scene"):
        parts = planning.once(scene_parts, point.scene, point.site)
    settings = tuple(point.class_settings.items())
    typical = planning.once(
        typical_objects_of, planning, (point.scene, point.site), point.classes, settings
    )
    _caution_of_settings(planning, point)
    scenes = tuple(
        planning.add_for(grid_point, SceneStage(part.recording), (), part.name) for part in parts
    )
    logs = [scene for part, scene in zip(parts, scenes, strict=True) if "train" in part.splits]
    requirements = plan_requirements(planning, grid_point)
    pog = planning.add_for(grid_point, PogStage(grid_point.roi, point.classes), logs)
    trial = Trial(
        grid_point=grid_point,
        label=trial_label(point, grid_point.axes),
        scene_label=task_label(grid_point, scenes[0].keys),
        interleaving=planning.once(interleaving, grid_point.rig),
        scenes=scenes,
        requirements=requirements,
        pog=pog,
        surrogates=plan_surrogates(planning, grid_point, pog),
        recall=plan_recall(planning, grid_point, logs),
        studies=tuple(filter(None, (study(planning, grid_point, logs) for study in STUDIES))),
    )
    if point.detector is None:
        return trial
    clouds = TrialClouds(planning, grid_point, parts, scenes)
    command = isinstance(point.evaluator, EvaluatorCommand)
    evaluator = plan_command if command else _EVALUATORS[str(point.evaluator)]
    return evaluator(trial, clouds, typical)


def _caution_of_settings(planning: Planning, point: Point) -> None:
    if point.detector is not None and point.training.mixed_precision == "everywhere":
        from training.device import NO_BFLOAT16, cpu_has_bfloat16, device

        if device().type == "cpu" and not cpu_has_bfloat16():
            planning.caution(NO_BFLOAT16)
    placement = planning.sweep.common.placements.get(point.placement)
    if placement is not None:
        sensors = (*placement.cameras, *placement.radars)
        planning.caution(*unused_sensor_warnings(point.placement, sensors))


def unused_sensor_warnings(name: str, sensors: Sequence[object]) -> list[str]:
    """Warn that detectors and surrogates ignore cameras and radars; nothing without any."""
    problem = f"cameras and radars ({len(sensors)}) make no clouds: detectors and surrogates"
    return [f"{name}: {problem} ignore them."] if sensors else []
