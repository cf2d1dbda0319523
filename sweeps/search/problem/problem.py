"""The configuration of a search, read, validated and prepared."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement
from lidarplace.base.class_names import check_among
from lidarplace.base.code_version import code_version
from lidarplace.base.errors import InputError, at
from lidarplace.base.metrics import METRICS
from lidarplace.base.plugin_folders import plugin_folder
from lidarplace.clouds.blind_lidars import check_not_blind
from lidarplace.clouds.own_body import check_mounts
from lidarplace.configuration.sensor import LOSSES
from lidarplace.configuration.vehicle import vehicle_of
from lidarplace.mounting.vehicle import zone_in_body
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, SURROGATES
from lidarplace.recall.detection_curve import default_curves, read_curves
from lidarplace.requirements.layout import RequirementLayout
from lidarplace.scenes.kinds import obstacles_around
from lidarplace.scenes.site import Poles
from lidarplace.scenes.sumo.settings import SumoScene
from sweeps.configuration.file import ConfigError, check, read_named, reading
from sweeps.configuration.grid import GridPoint, Sweep, build_sweep, refuse_overlaps
from sweeps.configuration.objective import PRETRAINED, ObjectiveSettings
from sweeps.configuration.requirements_file import (
    check_dead_sensors,
    check_lidars,
    lay_out_requirements,
)
from sweeps.configuration.rigs import Rigs
from sweeps.configuration.search import SearchFile, Tests, TrafficSettings
from sweeps.configuration.whole_paths import portable
from sweeps.execution.memory import check_memory
from sweeps.plan.named_files import outside_of
from sweeps.plan.plan import make_plan
from sweeps.plan.trial import Trial
from sweeps.search.problem.assess import Criteria
from sweeps.search.problem.constraints import Carrier, constraints_of, vehicle_in
from sweeps.search.problem.rig import MountedLidar, Rig, ordered, placement_of
from sweeps.search.problem.search_config import SearchConfig, as_plain
from sweeps.search.problem.slots import Assignment
from sweeps.search.problem.space import Space, rig_of
from sweeps.search.problem.start import start_of
from sweeps.search.problem.training_rigs import rigs_near, training_rigs
from sweeps.stages.task import Task, plain
from tracking.run_folders.search_json import UNNAMED
from training import code_of_network, network_of

_ANSWERING = {
    *("lidar", "weather", "surrogate", "placement", "placements"),
    *("detector", "training", "generalist", "mounting_errors", "allow_blind_lidars", "metrics"),
}
"""Keys, in addition to scene, ROI and classes, that decide the values of trials."""
ADAPTED = "first_"
"""Start of names of the rigs that the first round of `search.adapt` chose."""
OF_ALL_LIDARS = ("cloud_share", *LOSSES)
"""Keys of `lidar` that also hold for LiDARs with a model."""
_ELSEWHERE = {"trials", "vehicle", "cheapest"}
"""Keys of `search` that do not decide it, or are in its key by their content."""


@dataclass(frozen=True)
class SearchProblem(SearchConfig):
    """A search: its space, objectives and constraints.

    Attributes:
        models: LiDARs by name, those of the zones first, the last that of `lidar`.
        start: rigs to begin with.
        rigs: all placements of the configuration."""

    space: Space
    start: Mapping[str, list[Assignment]]
    criteria: Criteria
    rigs: Rigs

    @cached_property
    def key(self) -> str:
        """Identifier of the search among those of its name: equal while trials can be compared.

        That is while configuration, scene and code are the same; how many trials there are, and
        what comes after them, does not matter. Raises ConfigError, see `pog_tasks`."""
        _, trial = self.pog_tasks(self.sweep())
        content = {
            "pog": trial.pog.key,
            "code": self._code(),
            "recall": trial.recall.key if self.criteria.needs_objects and trial.recall else None,
            "search": _without_paths(self.file.search.model_dump(mode="json", exclude=_ELSEWHERE)),
            "models": dict(self.models),  # patterns and corrections by their content
            "vehicle": self.criteria.carrier.limits.body,  # a mesh by triangles, not by path
            "file": _without_paths(self.file.model_dump(mode="json", include=_ANSWERING)),
        }
        text = json.dumps(content, sort_keys=True, default=plain)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def _code(self) -> str:
        """Return the version of the code that evaluates trials; the POG has that of scenes."""
        values = {part.by for objective in self.file.search.objective for part in objective.parts}
        modules = ["sweeps.search.problem.assess", "sweeps.search.problem.space"]
        for registry in (SURROGATES, METRICS):
            modules += registry.modules(sorted(by for by in values if by in registry))
        if self.uses_generalist:
            assert self.file.detector is not None
            network = network_of(self.file.detector)
            modules += ["sweeps.stages.evaluate", *code_of_network(network)]
        return code_version(*modules)

    @property
    def uses_generalist(self) -> bool:
        """Whether a generalist evaluates trials."""
        return any(objective.uses_generalist for objective in self.file.search.objective)

    @property
    def pretrained(self) -> bool:
        """Whether that generalist is the one of a file."""
        return any(objective.evaluator == PRETRAINED for objective in self.file.search.objective)

    def outside(self, rig: Rig, name: str = "found") -> str | None:
        """Return why the generalist of a file cannot evaluate a rig; None if it can.

        Without such a generalist it is None, too. Raises ConfigError: the file cannot be read, or
        belongs to another network."""
        if not self.pretrained:
            return None
        placement = placement_of(rig, self.models, name)
        share = self.file.lidar.cloud_share
        return outside_of(self.file, placement.each_lidar(lambda own: own.thinned(share)))

    @cached_property
    def training_rigs(self) -> dict[str, Rig]:
        """Training rigs of a generalist, by name; none where the configuration names them."""
        number, seed = self.file.generalist.rigs, self.file.search.seed
        if not isinstance(number, int):
            return {}
        if self.file.search.near_start:
            start = [self.space.params(rig) for rig in self.start.values()]
            return rigs_near(self.space, start, number, seed)
        return training_rigs(self.space, self.models, number, seed)

    @property
    def seen_rigs(self) -> list[Placement]:
        """Placements that a generalist is trained on. Raises ValueError if a name is unknown."""
        named = self.file.generalist.rigs
        if isinstance(named, int):
            return [placement_of(rig, self.models) for rig in self.training_rigs.values()]
        return [self.rigs.of(self.file, name) for name in named]

    @property
    def traffic(self) -> TrafficSettings:
        """Test traffic of a generalist: as configured; simulated traffic has towns of its own."""
        traffic, scene = self.file.search.traffic, self.file.scene
        if not isinstance(scene, SumoScene):
            return traffic

        def in_towns(tests: Tests, first: int) -> Tests:
            return tuple({"scene.test_seed": first + 2 * i} | t for i, t in enumerate(tests))

        return TrafficSettings(
            search=in_towns(traffic.search, scene.seed + 1001),
            choice=in_towns(traffic.choice, scene.seed + 1002),
        )

    @property
    def tests(self) -> TrafficSettings:
        """The traffic, each once with every vehicle; trials and choice have different vehicles."""
        traffic, number = self.traffic, self.file.search.vehicles
        if number is None:
            return traffic

        def driven(tests: Tests, first: int) -> Tests:
            vehicles = range(first, first + number)
            return tuple(t | {"mounting_errors.vehicle": v} for t in tests for v in vehicles)

        return TrafficSettings(
            search=driven(traffic.search, 1), choice=driven(traffic.choice, 1 + number)
        )

    @property
    def folder(self) -> Path:
        """The run folder."""
        return self.file.output / self.file.name

    def sweep(self, scene: Mapping[str, Any] | None = None) -> Sweep:
        """Return a sweep of one placement and no detector, for its scene and POG.

        `scene`: key path -> value, changes of the scene. Raises ConfigError: a value is not
        allowed."""
        names, changes = self.file.surrogate.names, scene or {}
        if self.criteria.needs_objects:
            names = tuple(dict.fromkeys([*names, "expected_recall"]))
        point = self.point(changes, {key: f"robustness.scenes: {key}" for key in changes})
        surrogate = point.surrogate.model_copy(update={"names": names})
        fixed = {"placement": "line", "detector": None, "surrogate": surrogate}
        point = point.model_copy(update=fixed)
        grid_point = GridPoint(point, self.rigs.of(point), {})
        return Sweep(self.file, (grid_point,), (), self.source, self.rigs, self.path)

    def pog_tasks(self, sweep: Sweep) -> tuple[list[Task], Trial]:
        """Return the tasks that lead to a sweep's POG, and its trial. Raises ConfigError."""
        with at(self.path, ConfigError):
            plan = make_plan(sweep)
        (trial,) = plan.trials
        return plan.needed_for([trial.pog]), trial

    @cached_property
    def cautions(self) -> tuple[str, ...]:
        """Cautions of its log and classes, a line each. Raises ConfigError: they are wrong."""
        with at(self.path, ConfigError):
            return make_plan(self.sweep()).cautions

    def check_memory(self) -> None:
        """Raise ValueError if the POG, or surrogates of it, cannot fit into this machine."""
        tasks, trial = self.pog_tasks(self.sweep())
        check_memory([*tasks, trial.surrogates], self.file.ray.address)

    @property
    def start_rigs(self) -> dict[str, Rig]:
        """Rigs of `search.start`, with the fixed LiDARs, by name."""
        return {name: rig_of(start, self.space) for name, start in self.start.items()}

    @property
    def start_peers(self) -> dict[str, Rig]:
        """Rigs of `search.start` to compare with; none if it only has the paper's on the sedan."""
        rigs = {name: rig for name, rig in self.start_rigs.items() if not name.startswith(ADAPTED)}
        has_own = self.file.search.vehicle is not None or rigs.keys() & self.file.placements.keys()
        return rigs if has_own else {}

    def paper_rigs(self) -> dict[str, Rig]:
        """Return the paper's eight with the LiDAR of the key `lidar`."""
        mounts = {name: rig.mounts for name, rig in PAPER_PLACEMENTS.items()}
        lidars = {name: [MountedLidar(UNNAMED, "", m) for m in ms] for name, ms in mounts.items()}
        return {name: ordered(rig) for name, rig in lidars.items()}


def read_problem(
    path: Path, overrides: Sequence[str] = (), changes: Mapping[str, Any] | None = None
) -> SearchProblem:
    """Read the configuration of a search, with `changes`, key path -> plain data, after `--set`.

    Raises ConfigError: anything wrong with it."""
    source = read_named(path, overrides, SearchFile, changes)
    with at(path, ConfigError), plugin_folder(path.parent):
        problem = _problem(source, path)
        _check_what_comes_later(problem)
        return problem


def _problem(source: dict[str, Any], path: Path) -> SearchProblem:
    file = check(SearchFile, source, path)
    _check_keys(file, source)
    settings = file.search
    rigs = Rigs(file.placements, file)
    weather = file.weather.weather()
    lidar = file.lidar.lidar().in_weather(weather)
    chosen = {
        name: model.lidar(file.lidar.losses).in_weather(weather)
        for name, model in settings.models.items()
    } or {UNNAMED: lidar}
    fixed = [
        MountedLidar(f.model or next(iter(chosen)), "", Mount(*f.pose)) for f in settings.fixed
    ]
    space = Space(settings, tuple(chosen), fixed)
    start = {name: start_of(file, rigs, name, space) for name in settings.start}
    models = chosen | {UNNAMED: lidar}
    _check_body(file, space, fixed, models)
    for key in file.verify.set if settings.models and file.verify is not None else ():
        if key.startswith("lidar.") and key.removeprefix("lidar.") not in OF_ALL_LIDARS:
            problem = "changes only the paper's rigs; the others have a model of search.models"
            raise InputError(problem, key=f"verify.set.{key}")
    criteria = Criteria(
        objectives=settings.objective,
        constraints=constraints_of(file),
        carrier=Carrier.of(file, models, _laid(file, chosen, space.numbers[1] + len(fixed))),
        surrogate=file.surrogate,
        azimuth_stride=settings.azimuth_stride,
        errors=file.mounting_errors.errors(),
        seed=file.scene.seed,
    )
    whole = portable(source, path.parent)
    if file.site is not None:  # strips in place of kerbs
        whole["search"]["zones"] = {name: as_plain(zone) for name, zone in settings.zones.items()}
    return SearchProblem(path, whole, file, models, space, start, criteria, rigs)


def _laid(
    file: SearchFile, models: Mapping[str, Lidar], most_lidars: int
) -> tuple[RequirementLayout, ...]:
    """Lay out the requirements around the vehicle. Raises InputError."""
    requirements, curves_file = file.search.requirements, file.surrogate.curves
    if not requirements:
        return ()
    with at(key="search.requirements"):
        for name, lidar in models.items():
            check_lidars(Placement(name, [Mount()], lidar), requirements)
        for requirement in requirements:
            further = (sensor.kind for sensor in file.search.further())
            check_dead_sensors(requirement, [*["lidar"] * most_lidars, *further])
    with reading("surrogate.curves"):
        curves = default_curves() if curves_file is None else read_curves(curves_file)
    vehicle = vehicle_in(file)
    hiding = vehicle.with_walls if isinstance(vehicle, Poles) else vehicle
    return lay_out_requirements(requirements, hiding, curves, "search.requirements")


def _check_keys(file: SearchFile, source: Mapping[str, Any]) -> None:
    """Reject keys that have no effect here, or contradict each other. Raises InputError."""
    settings = file.search
    others = {"placement": "start", "promote": "trials"}
    for key in ("seed", "placement", "promote", "requirements", "vehicle"):
        if key in source:
            replacement = f"search.{others.get(key, key)}"
            raise InputError(f"key of a sweep; a search has {replacement}", key=key)
    if "evaluator" in source:
        fix = "select it by search.objective, such as generalist.recall"
        raise InputError("key of a sweep", key="evaluator", fix=fix)
    if file.verify is not None:
        refuse_overlaps(file.verify.set, "verify.set")
        for key in ("placement", "seed"):
            if key in file.verify.set:
                fix = "set verify.seeds"
                raise InputError("the verification varies it", key=f"verify.set.{key}", fix=fix)
    if UNNAMED in settings.models:
        raise InputError("is the name of the key `lidar`", key=f"search.models.{UNNAMED}")
    for objective in settings.objective:
        with at(key=f"search.objective: {objective.name}"):
            _check_objective(objective, file)


def _check_objective(objective: ObjectiveSettings, file: SearchFile) -> None:
    for part in objective.parts:
        check_among(part.weights or (), file.classes)
    if objective.measured and file.detector is None:
        raise InputError("needs a detector")
    if objective.by in OBJECT_SURROGATES and file.lidar.tilt_in_degrees:
        raise InputError("uses the declared mounts", fix="remove lidar.tilt_in_degrees")


def _check_body(
    file: SearchFile, space: Space, fixed: list[MountedLidar], models: Mapping[str, Lidar]
) -> None:
    """Reject zones and fixed LiDARs inside of the body, and fixed ones that are blind."""
    vehicle = vehicle_of(file.search.vehicle)
    for zone in space.zones:
        if zone_in_body(zone, vehicle)[1]:
            raise InputError("is inside the vehicle's body", key=f"search.zones.{zone.name}")
    around = None if file.site is None else obstacles_around(file.scene, file.site)
    if around is not None:
        for zone in space.zones:
            with at(key=f"search.zones.{zone.name}"):
                around.check_zone(zone)
    if not fixed:
        return
    with at(key="search.fixed"):
        rig = placement_of(tuple(fixed), models, "fixed")
        check_mounts(rig, vehicle)
        if around is not None:
            around.check(rig)
        if not file.allow_blind_lidars:
            check_not_blind(rig, file.voxel_roi(), vehicle_in(file))


def _check_what_comes_later(problem: SearchProblem) -> None:
    """Report mistakes in scene, robustness and verification now. Raises InputError."""
    problem.pog_tasks(problem.sweep())
    file = problem.file
    for name, changes in (file.robustness.scenes if file.robustness else {}).items():
        _check_scene(changes, f"robustness.scenes.{name}", "scene.density")
        problem.pog_tasks(problem.sweep(changes))
    if problem.uses_generalist:
        _check_traffic(problem)
    if file.verify is None:
        return
    config = problem.verify_settings({"found_1": problem.paper_rigs()["line"]}, ["line"])
    with at(key="verify"):
        sweep = build_sweep(config, problem.path)
    if sweep.points[0].point.detector is None:
        raise InputError("needs a detector", key="verify")


def _check_scene(changes: Mapping[str, Any], where: str, example: str) -> None:
    """Reject keys outside of the scene, or inside of another key. Raises InputError."""
    refuse_overlaps(changes, where)
    for key in changes:
        if not key.startswith("scene."):
            raise InputError(key=f"{where}.{key}", expected=f"a key of scene, such as {example}")


def _check_traffic(problem: SearchProblem) -> None:
    """Check that a search by a generalist has traffic, and different traffic. Raises InputError."""
    traffic = problem.traffic
    for name, every in (("search", traffic.search), ("choice", traffic.choice)):
        where = f"search.traffic.{name}"
        for changes in every:
            if not changes:
                rule = "trials, choice and verification need different traffic"
                fix = "name another log, such as {scene.test_folder: other_log}"
                raise InputError(rule, key=where, fix=fix)
            _check_scene(changes, where, "scene.test_seed")
            names = {key: f"search.traffic.{name}: {key}" for key in changes}
            problem.point(changes, names)
        if any(changes in every[:number] for number, changes in enumerate(every)):
            raise InputError("duplicate traffic", key=where)
    if problem.file.search.vehicles is not None and not problem.file.mounting_errors.errors():
        needed = "needs mounting_errors, without which all are equal"
        raise InputError(needed, key="search.vehicles")
    with at(key="generalist.rigs"):
        training_lidars = {lidar for rig in problem.seen_rigs for lidar in rig.lidars}
    unseen = [name for name in problem.space.models if problem.models[name] not in training_lidars]
    if unseen and not isinstance(problem.file.generalist.rigs, int):
        none = f"none of them has the LiDAR {unseen[0]}, which the search chooses"
        raise InputError(none, key="generalist.rigs")
    if any(changes in traffic.choice for changes in traffic.search):
        raise InputError("search and choice need different traffic", key="search.traffic")
    if problem.pretrained:
        _check_pretrained(problem)


def _check_pretrained(problem: SearchProblem) -> None:
    """Check that the generalist of a file covers rigs of the zones and those to compare with."""
    if (seeds := len(problem.file.search.seeds)) > 1:
        one = "a pretrained generalist has one seed"
        raise InputError(one, key="search.seeds", expected=1, found=seeds)
    compared = problem.start_peers
    if not compared and problem.file.search.vehicle is None:
        compared = {f"{name} of the paper": rig for name, rig in problem.paper_rigs().items()}
    zones = dict.fromkeys(problem.training_rigs, "rigs of the zones")
    for name, rig in {**problem.training_rigs, **compared}.items():
        if (outside := problem.outside(rig, name)) is not None:
            raise InputError(f"{zones.get(name, name)}: {outside}", key="search")


def _without_paths(value: Any) -> Any:
    """Return settings without the files of LiDARs; only text under these keys is a file."""
    if isinstance(value, dict):
        return {
            key: _without_paths(inner)
            for key, inner in value.items()
            if key not in ("pattern", "correction") or not isinstance(inner, str)
        }
    return [_without_paths(inner) for inner in value] if isinstance(value, list) else value
