"""The run folder of a search: results as files that stay readable without this project."""

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
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, RAY_SURROGATES, SURROGATES
from lidarplace.requirements.tables import Ground, by_rig, case_table
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.file import public_yaml
from sweeps.configuration.objective import ObjectiveSettings
from sweeps.configuration.requirements_file import check_rig_fits
from sweeps.results.pictures import uncovered
from sweeps.results.rigs import FILE as RIGS
from sweeps.search.output.tables import greedy_table, importances, trials_table
from sweeps.search.output.terminal import greedy_warnings, rig_warnings
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig, placement_of
from sweeps.search.problem.zone_records import zones_of
from sweeps.search.trials.aggregate import class_weights
from sweeps.search.trials.study import assessment_of, finished_trials, journal_path
from sweeps.search.verification.winners import AssessedRig, SearchFindings, stride_error
from tracking.mlflow.uri import absolute_uri
from tracking.run_folders import search_json as kinds
from tracking.run_folders import search_tables as contract
from tracking.run_folders.arrays import Grounds, UnseenMaps
from tracking.run_folders.json_file import Surroundings, Triangles

_VERSIONS = ("numpy", "numba", "torch", "ray", "mlflow", "pandas", "optuna")
_OPTIONAL = [table.file for table in contract.TABLES if not table.needed]
"""Files that not every search has."""
_OPTIONAL += ["placement.yaml", "sweep.yaml", RIGS, UnseenMaps.FILE, Grounds.FILE]
"""Files that not every search has."""


def write_search(
    folder: Path, problem: SearchProblem, findings: SearchFindings, command: str, seconds: float
) -> None:
    """Write all results into `folder`."""
    about = _about(problem, findings, command, seconds)
    for name in _OPTIONAL:  # of an earlier search of this name, or of fewer trials
        (folder / name).unlink(missing_ok=True)
    about.trials_table.write(trials_table(findings.study, problem), folder)
    if findings.certificate is not None:
        contract.BOUND.write(pd.DataFrame(findings.certificate.history), folder)
        contract.GREEDY.write(greedy_table(findings.certificate), folder)
    if findings.chosen is not None:
        contract.CHOSEN.write(findings.chosen, folder)
    if findings.robustness is not None:
        contract.ROBUSTNESS.write(findings.robustness, folder)
    if problem.criteria.carrier.requirements:
        _write_requirements(folder, problem, findings)
    write_text(folder / "config.yaml", public_yaml(problem.source))
    if findings.trials:
        write_text(folder / "placement.yaml", problem.placement_text(findings.rigs["found_1"].rig))
        write_text(folder / "sweep.yaml", _sweep(problem, findings))
        names = (*findings.best, findings.baseline)
        write_text(folder / RIGS, problem.rigs_text({n: findings.rigs[n].rig for n in names}))
        if findings.grids:
            _maps(problem, findings).write(folder)
    about.write(folder)


def _write_requirements(folder: Path, problem: SearchProblem, findings: SearchFindings) -> None:
    """Write the result of each requirement under every rig, and where it fails."""
    carrier = problem.criteria.carrier
    rigs = findings.rigs.items()
    outcomes = {name: carrier.requirement_results(rig.rig, name) for name, rig in rigs}
    tables = {name: case_table(results) for name, results in outcomes.items()}
    contract.REQUIREMENTS.write(by_rig(tables), folder)
    names = [layout.requirement.name for layout in carrier.requirements]
    grounds = {
        name: [Ground.of(result) for result in results] for name, results in outcomes.items()
    }
    Grounds.of(outline(carrier.vehicle), names, grounds).write(folder)


def _maps(problem: SearchProblem, findings: SearchFindings) -> UnseenMaps:
    """Return the maps of the POG by class, and of what the best rigs leave unseen of it."""
    roi, method = next(iter(findings.grids.values())).roi, problem.file.surrogate.method
    covered = {
        name: coverage(placement_of(findings.rigs[name].rig, problem.models, name), roi, method)
        for name in ("found_1", findings.baseline)
    }
    pog, unseen = {}, {}
    for name, grid in findings.grids.items():
        pog[name] = uncovered([grid], np.broadcast_to(np.False_, roi.shape))
        unseen[name] = {rig: uncovered([grid], seen) for rig, seen in covered.items()}
    return UnseenMaps(pog, unseen)


def _sweep(problem: SearchProblem, findings: SearchFindings) -> str:
    """Return a sweep of the winners and the paper's rigs, without those that a sweep rejects."""
    most = problem.file.verify.top if problem.file.verify is not None else 3
    paper, ruled_out = findings.of_role("paper"), _ruled_out(problem, findings)
    places = [_places(rig) for rig in paper.values()]
    # A search that began with one of the eight need not train it twice.
    new = [name for name in findings.best if _places(findings.rigs[name].rig) not in places]
    rigs = {name: findings.rigs[name].rig for name in new[:most]}
    if not paper:
        rigs[findings.baseline] = findings.rigs[findings.baseline].rig
    others = [name for name in paper if name not in ruled_out]
    return public_yaml(problem.verify_settings(rigs, others))


def _places(rig: Rig) -> set[tuple[str, Mount]]:
    return {(lidar.model, lidar.mount) for lidar in rig}


def _ruled_out(problem: SearchProblem, findings: SearchFindings) -> list[str]:
    """Return the paper's rigs that do not fit the vehicle, the ROI or the requirements."""
    carrier, ruled_out = problem.criteria.carrier, []
    for name, rig in findings.of_role("paper").items():
        placement = placement_of(rig, problem.models, name)
        try:
            check_rig_fits(placement, carrier.vehicle, problem.file.search.requirements)
            if not problem.file.allow_blind_lidars:
                check_not_blind(placement, carrier.roi, carrier.vehicle)
        except ValueError:
            ruled_out.append(name)
    return ruled_out


def _about(
    problem: SearchProblem, findings: SearchFindings, command: str, seconds: float
) -> kinds.SearchResult:
    file, criteria = problem.file, problem.criteria
    search, vehicle = file.search, criteria.carrier.vehicle
    several = len(search.objective) > 1
    trials = list(finished_trials(findings.study))
    different = len({problem.space.rig(trial.params) for trial in trials})
    warned = {name: findings.rigs[name].rig for name in (*findings.best[:1], findings.baseline)}
    warned |= problem.start_rigs
    return kinds.SearchResult(
        name=file.name,
        command=command,
        commands=_commands(problem, findings),
        seconds=seconds,
        objectives=[_objective(objective, problem) for objective in search.objective],
        over=search.said_of(problem.traffic.search),
        chosen_over=search.said_of(problem.traffic.choice),
        **search.model_dump(include={"sampler", "seed", "batch_size"}),
        trials=len(trials),
        evaluations=different,
        repeated=len(trials) - different,
        feasible=sum(assessment_of(trial).feasible for trial in trials),
        sampler_seconds=findings.timing.sampler,
        evaluation_seconds=findings.timing.evaluation,
        constraints=[
            kinds.Constraint(name=c.name, unit=c.unit, limit=c.limit, sense=c.sense)
            for c in criteria.constraints
        ],
        classes=file.classes,
        roi=Roi(file.roi.x, file.roi.y, file.roi.z, file.surrogate.resolution),
        frames=next((grid.frames for grid in findings.grids.values()), 0),
        zones=zones_of(problem.space),
        vehicle=vehicle.boxes.tolist(),
        vehicle_mesh=Triangles.of(vehicle.mesh),
        site=Surroundings.of(vehicle),
        models={
            name: kinds.Model(
                price=criteria.carrier.totals["price"][name],
                beams=lidar.beams,
                azimuth_steps=lidar.azimuth_steps,
            )
            for name, lidar in problem.models.items()
        },
        bound=_bound(findings, problem),
        best=findings.best if several else findings.best[:1],
        front=len(findings.trials) if several else None,
        parameters=problem.space.numbers_of_parameters[1],
        baseline=findings.baseline,
        rigs={name: _rig(assessed) for name, assessed in findings.rigs.items()},
        importance=importances(findings.study) or None,
        stride=_stride(problem, findings),
        cautions=[*problem.cautions, *greedy_warnings(problem), *rig_warnings(warned, problem)],
        linear_share=_linear_share(problem, findings),
        tracking_uri=public_url(absolute_uri(file.tracking_uri)),
        versions={"python": platform.python_version()} | {n: version(n) for n in _VERSIONS},
    )


def _stride(problem: SearchProblem, findings: SearchFindings) -> kinds.Stride | None:
    criteria, error = problem.criteria, stride_error(findings.rigs.values())
    if not any(objective.by in RAY_SURROGATES for objective in criteria.objectives):
        return None
    return kinds.Stride(azimuth_stride=criteria.azimuth_stride, relative_error=error)


def _linear_share(problem: SearchProblem, findings: SearchFindings) -> float | None:
    """Return the share of `expected_ig` of the best rig, the largest of the classes.

    None if it is no objective."""
    if not findings.best or not any(o.by == "expected_ig" for o in problem.criteria.objectives):
        return None
    q = problem.criteria.surrogate.detection_probability
    rig = placement_of(findings.rigs["found_1"].rig, problem.models)
    return float(linear_share(findings.grids, rig, q).max())


def _objective(objective: ObjectiveSettings, problem: SearchProblem) -> kinds.Objective:
    quantity, weights = SURROGATES.get(objective.by) or METRICS.get(objective.by), None
    if objective.measured:
        weights = class_weights(objective, problem.file.classes)
    elif objective.of_traffic:
        weights = objective.weights_of(problem.file.classes)
    unit = quantity.unit if quantity else ""
    if objective.by in OBJECT_SURROGATES and weights and len(weights) > 1:
        kind = "sum" if {*weights.values()} == {1.0} else "weighted sum"
        unit += f", {kind} over {len(weights)} classes"
    return kinds.Objective(
        name=objective.name,
        by=objective.by,
        unit="times the need" if objective.by == "margin" else unit,
        direction=objective.best,
        weights=weights,
    )


def _rig(assessed: AssessedRig) -> kinds.Rig:
    return kinds.Rig(
        role=assessed.role,
        feasible=assessed.assessment.feasible,
        mounts=[astuple(lidar.mount) for lidar in assessed.rig],
        models=[lidar.model for lidar in assessed.rig],
        zones=[lidar.zone or None for lidar in assessed.rig],
        values=assessed.all_values,
        searched=assessed.searched,
        measures=assessed.assessment.measures,
    )


def _bound(findings: SearchFindings, problem: SearchProblem) -> kinds.Bound:
    """Return a bound on the first objective, as the search computes it, with its azimuth stride."""
    certificate = findings.certificate
    if certificate is None:
        return kinds.Bound(value=None, reason=findings.no_certificate)
    name = problem.criteria.objectives[0].name
    best = findings.rigs["found_1"].searched[name] if findings.trials else certificate.value
    return kinds.Bound(
        value=certificate.bound,
        by_gains=certificate.by_gains,
        greedy=certificate.value,
        candidates=certificate.candidates,
        best_value=best,
        gap_percent=100 * (1 - best / certificate.bound) if certificate.bound else 0.0,
        reason=None,
    )


def _verification(problem: SearchProblem, findings: SearchFindings) -> str:
    """Describe the sweep of the winners, and which of the paper's rigs it leaves out."""
    left, ruled_out = len(findings.of_role("paper")), _ruled_out(problem, findings)
    if not left:
        return f"train detectors for it and for {findings.baseline}"
    left -= len(ruled_out)
    why = "do not fit the vehicle or its requirements"
    if not left:
        return f"train detectors for it alone, as the paper's eight {why}"
    rest = f"; left out, as they {why}: {', '.join(ruled_out)}" if ruled_out else ""
    return f"train detectors for it and for {f'{left} of ' if rest else ''}the paper's eight{rest}"


def _commands(problem: SearchProblem, findings: SearchFindings) -> list[kinds.Command]:
    folder, lines = problem.folder, {}
    if findings.trials:
        rig = str(folder / "placement.yaml")
        lines[_verification(problem, findings)] = command("run", str(folder / "sweep.yaml"))
        lines["move LiDARs of these rigs by hand"] = command("studio", str(folder / RIGS))
        if isinstance(scene := problem.file.scene, LogScene):
            view = command("view", str(scene.folder), "--placement", rig)
            lines["see what it sees in a frame of the log"] = view
    journal = shlex.quote(str(journal_path(folder)))
    lines["show all trials in a browser"] = f"optuna-dashboard {journal}"
    return [kinds.Command(what=purpose, line=line) for purpose, line in lines.items()]
