"""The run folder of a search: what was found, as files that stay readable without this project."""

import platform
import shlex
from dataclasses import astuple
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace import Mount, Roi
from lidarplace.base.metrics import METRICS
from lidarplace.clouds.blind_lidars import check_not_blind
from lidarplace.command_line.invocation import command
from lidarplace.coverage import coverage
from lidarplace.files.atomic import write_text
from lidarplace.files.secret_urls import public_url
from lidarplace.mounting.outline import outline
from lidarplace.pog.surrogates.evaluate import linear_share
from lidarplace.pog.surrogates.table import RAY_SURROGATES, SURROGATES
from lidarplace.requirements.tables import Ground, by_rig, case_table
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.file import public_yaml
from sweeps.configuration.question import check_asked
from sweeps.configuration.search import ObjectiveSettings
from sweeps.results.pictures import uncovered
from sweeps.search.output.tables import greedy_table, importances, trials_table
from sweeps.search.output.terminal import greedy_warnings, rig_warnings
from sweeps.search.problem.choice import Choices, placement_of
from sweeps.search.problem.problem import Problem
from sweeps.search.problem.space import rig_of
from sweeps.search.trials.aggregate import class_weights
from sweeps.search.trials.study import assessment_of, finished_trials, journal_path
from sweeps.search.verification.winners import Found, Judged, stride_error
from tracking.mlflow.uri import absolute_uri
from tracking.run_folders import search_json as kinds
from tracking.run_folders import search_tables as contract
from tracking.run_folders.arrays import Grounds, UnseenMaps
from tracking.run_folders.json_file import Triangles

_VERSIONS = ("numpy", "numba", "torch", "ray", "mlflow", "pandas", "optuna")
_OPTIONAL = [table.file for table in contract.TABLES if not table.needed]
_OPTIONAL += ["placement.yaml", "sweep.yaml", UnseenMaps.FILE, Grounds.FILE]
"""Files that not every search has."""


def write_search(
    folder: Path, problem: Problem, found: Found, command: str, seconds: float
) -> None:
    """Write all results into `folder`."""
    about = _about(problem, found, command, seconds)
    for name in _OPTIONAL:  # of an earlier search of this name, or of fewer trials
        (folder / name).unlink(missing_ok=True)
    about.trials_table.write(trials_table(found.study, problem), folder)
    if found.certificate is not None:
        contract.BOUND.write(pd.DataFrame(found.certificate.history), folder)
        contract.GREEDY.write(greedy_table(found.certificate), folder)
    if found.chosen is not None:
        contract.CHOSEN.write(found.chosen, folder)
    if found.robustness is not None:
        contract.ROBUSTNESS.write(found.robustness, folder)
    if problem.question.carrier.requirements:
        _write_requirements(folder, problem, found)
    write_text(folder / "config.yaml", public_yaml(problem.source))
    if found.trials:
        write_text(folder / "placement.yaml", problem.placement_text(found.judged["found_1"].rig))
        write_text(folder / "sweep.yaml", _sweep(problem, found))
        if found.grids:
            _maps(problem, found).write(folder)
    about.write(folder)


def _write_requirements(folder: Path, problem: Problem, found: Found) -> None:
    """What becomes of each requirement under every rig that is known, and where it fails."""
    carrier = problem.question.carrier
    outcomes = {name: carrier.judged(own.rig, name) for name, own in found.judged.items()}
    tables = {name: case_table(own) for name, own in outcomes.items()}
    contract.REQUIREMENTS.write(by_rig(tables), folder)
    names = [own.requirement.name for own in carrier.requirements]
    grounds = {name: [Ground.of(one) for one in own] for name, own in outcomes.items()}
    Grounds.of(outline(carrier.vehicle), names, grounds).write(folder)


def _maps(problem: Problem, found: Found) -> UnseenMaps:
    """The maps of the POG by class, and of what the best rigs leave unseen of it."""
    roi, method = next(iter(found.grids.values())).roi, problem.file.surrogate.method
    covered = {
        name: coverage(placement_of(found.judged[name].rig, problem.models, name), roi, method)
        for name in ("found_1", found.baseline)
    }
    pog, unseen = {}, {}
    for name, grid in found.grids.items():
        pog[name] = uncovered([grid], np.broadcast_to(np.False_, roi.shape))
        unseen[name] = {rig: uncovered([grid], own) for rig, own in covered.items()}
    return UnseenMaps(pog, unseen)


def _sweep(problem: Problem, found: Found) -> str:
    """A sweep of the winners and the paper's rigs, without those that a sweep refuses."""
    most = problem.file.verify.top if problem.file.verify is not None else 3
    paper, ruled_out = found.of_role("paper"), _ruled_out(problem, found)
    places = [_places(rig) for rig in paper.values()]
    # A search that began with one of the eight need not train it twice.
    new = [name for name in found.best if _places(found.judged[name].rig) not in places]
    rigs = {name: found.judged[name].rig for name in new[:most]}
    others = [name for name in paper if name not in ruled_out]
    return public_yaml(problem.verify_settings(rigs, others))


def _places(rig: Choices) -> set[tuple[str, Mount]]:
    return {(lidar.model, lidar.mount) for lidar in rig}


def _ruled_out(problem: Problem, found: Found) -> list[str]:
    """The paper's rigs that do not fit the vehicle, the ROI or the requirements."""
    carrier, ruled_out = problem.question.carrier, []
    for name, rig in found.of_role("paper").items():
        placement = placement_of(rig, problem.models, name)
        try:
            check_asked(placement, carrier.vehicle, problem.file.search.requirements)
            if not problem.file.allow_blind_lidars:
                check_not_blind(placement, carrier.roi, carrier.vehicle)
        except ValueError:
            ruled_out.append(name)
    return ruled_out


def _about(problem: Problem, found: Found, command: str, seconds: float) -> kinds.SearchResult:
    file, question = problem.file, problem.question
    search, vehicle = file.search, question.carrier.vehicle
    several = len(search.objective) > 1
    trials = list(finished_trials(found.study))
    different = len({problem.space.rig(trial.params) for trial in trials})
    warned = {name: found.judged[name].rig for name in (*found.best[:1], found.baseline)}
    warned |= {name: rig_of(placed, problem.space) for name, placed in problem.start.items()}
    stride = None
    if any(objective.by in RAY_SURROGATES for objective in question.objectives):
        stride = kinds.Stride(
            azimuth_stride=question.azimuth_stride,
            relative_error=stride_error(found.judged.values()),
        )
    return kinds.SearchResult(
        name=file.name,
        command=command,
        commands=_commands(problem, found),
        seconds=seconds,
        objectives=[_objective(objective, problem) for objective in search.objective],
        over=search.said_of(problem.traffic.search),
        chosen_over=search.said_of(problem.traffic.choice),
        **search.model_dump(include={"sampler", "seed", "batch_size"}),
        trials=len(trials),
        evaluations=different,
        repeated=len(trials) - different,
        feasible=sum(assessment_of(trial).feasible for trial in trials),
        sampler_seconds=found.timing.sampler,
        evaluation_seconds=found.timing.evaluation,
        constraints=[
            kinds.Constraint(name=c.name, unit=c.unit, limit=c.limit, sense=c.sense)
            for c in question.constraints
        ],
        classes=file.classes,
        roi=Roi(file.roi.x, file.roi.y, file.roi.z, file.surrogate.resolution),
        frames=next((grid.frames for grid in found.grids.values()), 0),
        zones=[
            kinds.Zone(
                name=zone.name,
                polygon=zone.polygon,
                z=zone.z,
                **{f"{angle}_deg": span for angle, span in problem.space.spans(zone.name).items()},
            )
            for zone in problem.space.zones
        ],
        vehicle=vehicle.boxes.tolist(),
        vehicle_mesh=Triangles.of(vehicle.mesh),
        models={
            name: kinds.Model(
                price=question.carrier.totals["price"][name],
                beams=lidar.beams,
                azimuth_steps=lidar.azimuth_steps,
            )
            for name, lidar in problem.models.items()
        },
        bound=_bound(found, problem),
        best=found.best if several else found.best[:1],
        front=len(found.trials) if several else None,
        parameters=max(len(problem.space.distributions(own)) for own in problem.space.makeups),
        baseline=found.baseline,
        rigs={name: _rig(own) for name, own in found.judged.items()},
        importance=importances(found.study) or None,
        stride=stride,
        cautions=[*problem.cautions, *greedy_warnings(problem), *rig_warnings(warned, problem)],
        linear_share=_linear_share(problem, found),
        tracking_uri=public_url(absolute_uri(file.tracking_uri)),
        versions={"python": platform.python_version()} | {n: version(n) for n in _VERSIONS},
    )


def _linear_share(problem: Problem, found: Found) -> float | None:
    """Of `expected_ig` of the best rig, the largest of the classes; None if it is no objective."""
    if not found.best or not any(o.by == "expected_ig" for o in problem.question.objectives):
        return None
    q = problem.question.surrogate.detection_probability
    rig = placement_of(found.judged["found_1"].rig, problem.models)
    return float(linear_share(found.grids, rig, q).max())


def _objective(objective: ObjectiveSettings, problem: Problem) -> kinds.Objective:
    own, weights = SURROGATES.get(objective.by) or METRICS.get(objective.by), None
    if objective.measured:
        weights = class_weights(objective, problem.file.classes)
    elif objective.of_traffic:
        weights = objective.weights_of(problem.file.classes)
    return kinds.Objective(
        name=objective.name,
        by=objective.by,
        unit="" if own is None else own.unit,
        direction=objective.best,
        weights=weights,
    )


def _rig(own: Judged) -> kinds.Rig:
    return kinds.Rig(
        role=own.role,
        feasible=own.assessment.feasible,
        mounts=[astuple(lidar.mount) for lidar in own.rig],
        models=[lidar.model for lidar in own.rig],
        zones=[lidar.zone or None for lidar in own.rig],
        values=own.all_values,
        searched=own.searched,
        measures=own.assessment.measures,
    )


def _bound(found: Found, problem: Problem) -> kinds.Bound:
    """How good the first objective can be; as the search computes it, with its azimuth stride."""
    certificate = found.certificate
    if certificate is None:
        return kinds.Bound(value=None, reason=found.no_certificate)
    name = problem.question.objectives[0].name
    best = found.judged["found_1"].searched[name] if found.trials else certificate.value
    return kinds.Bound(
        value=certificate.bound,
        by_gains=certificate.by_gains,
        greedy=certificate.value,
        candidates=certificate.candidates,
        best_value=best,
        gap_percent=100 * (1 - best / certificate.bound) if certificate.bound else 0.0,
        reason=None,
    )


def _verification(problem: Problem, found: Found) -> str:
    """What the sweep of the winners does, and which of the paper's rigs it does without."""
    left, ruled_out = len(found.of_role("paper")), _ruled_out(problem, found)
    left -= len(ruled_out)
    why = "do not fit the vehicle or its requirements"
    if not left:
        return f"train detectors for it alone, as the paper's eight {why}"
    rest = f"; left out, as they {why}: {', '.join(ruled_out)}" if ruled_out else ""
    return f"train detectors for it and for {f'{left} of ' if rest else ''}the paper's eight{rest}"


def _commands(problem: Problem, found: Found) -> list[kinds.Command]:
    folder, lines = problem.folder, {}
    if found.trials:
        rig = str(folder / "placement.yaml")
        lines[_verification(problem, found)] = command("run", str(folder / "sweep.yaml"))
        if isinstance(scene := problem.file.scene, LogScene):
            view = command("view", str(scene.folder), "--placement", rig)
            lines["see what it sees in a frame of the log"] = view
    journal = shlex.quote(str(journal_path(folder)))
    lines["look at all trials in a browser"] = f"optuna-dashboard {journal}"
    return [kinds.Command(what=what, line=line) for what, line in lines.items()]
