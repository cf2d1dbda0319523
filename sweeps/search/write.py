"""The run folder of a search: what was found, as files that stay readable without this project."""

from __future__ import annotations

import json
import platform
import shlex
from collections.abc import Mapping
from dataclasses import astuple
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from lidarplace.files import replacing
from sweeps.pictures import save_arrays
from sweeps.search.as_sweep import placement_settings, sweep_settings
from sweeps.search.certificate import Certificate
from sweeps.search.found import Found
from sweeps.search.optuna_figures import importances, write_optuna_figures
from sweeps.search.problem import Problem
from sweeps.search.settings import ObjectiveSettings
from sweeps.search.study import assessment_of, finished_trials, journal_path
from sweeps.search.tables import greedy_table, trials_table
from sweeps.search.unseen import maps
from sweeps.search.winners import Judged, stride_error
from sweeps.store import write_text
from tracking.mlflow_uri import hide_password, public_uri

_VERSIONS = ("numpy", "numba", "torch", "ray", "mlflow", "pandas", "optuna")

_UNITS = {"price": "", "expected_points": "points", "m_sog": "nats"}


def write_search(
    folder: Path, problem: Problem, found: Found, command: str, seconds: float
) -> None:
    """Write all results into `folder`, each file renamed into place."""
    uri = problem.file.tracking_uri
    tables = {"trials": trials_table(found.study, problem)}
    if found.certificate is not None:
        tables["bound"] = found.certificate.history
        gains = found.certificate.gains
        tables["greedy"] = greedy_table(found.certificate.chosen, gains, 0.0)
    if found.robustness is not None:
        tables["robustness"] = found.robustness
    for name, table in tables.items():
        _parquet(folder / f"{name}.parquet", table)
    config = yaml.safe_dump(dict(problem.source), sort_keys=False)
    write_text(folder / "config.yaml", hide_password(config, uri))
    if found.trials:
        write_text(folder / "placement.yaml", _placement(problem, found))
        write_text(folder / "sweep.yaml", hide_password(_sweep(problem, found), uri))
        if found.grids:
            rigs = {name: found.judged[name].rig for name in ("found_1", found.baseline)}
            save_arrays(folder / "maps.npz", maps(rigs, problem, found.grids))
    names = [objective.name for objective in problem.file.search.objective]
    write_optuna_figures(found.study, names, folder / "optuna")
    about = _about(problem, found, hide_password(command, uri), seconds)
    write_text(folder / "search.json", json.dumps(_finite(about), indent=1))


def _parquet(path: Path, table: pd.DataFrame) -> None:
    with replacing(path) as partial:
        table.to_parquet(partial, index=False)


def _placement(problem: Problem, found: Found) -> str:
    """The best rig as a file for `lidarplace.view` and others, metres and radians."""
    settings = placement_settings(found.judged["found_1"].rig, problem.file)
    return yaml.safe_dump(settings, sort_keys=False)


def _sweep(problem: Problem, found: Found) -> str:
    """A sweep of the winners and the paper's eight, which `sweeps.run` takes as it is."""
    verify = problem.file.verify
    top = found.best[: verify.top if verify is not None else 3]
    rigs = {name: found.judged[name].rig for name in top}
    config = sweep_settings(problem.source, problem.file, rigs, f"{problem.file.name}-verify")
    paper = [name for name, own in found.judged.items() if own.role == "paper"]
    config.setdefault("detector", problem.file.detector)
    config["grid"] = {"placement": [*top, *paper]}
    if verify is not None:
        config["grid"]["seed"] = list(verify.seeds)
        for key, value in verify.set.items():
            *parents, last = key.split(".")
            inner = config
            for parent in parents:
                inner = inner.setdefault(parent, {})
            inner[last] = value
    return yaml.safe_dump(config, sort_keys=False)


def _about(problem: Problem, found: Found, command: str, seconds: float) -> dict[str, Any]:
    file, question = problem.file, problem.question
    search = file.search
    trials = list(finished_trials(found.study))
    roi = file.roi.model_dump(mode="json") | {"resolution": file.surrogate.resolution}
    return {
        "name": file.name,
        "command": command,
        "commands": _commands(problem, bool(found.trials)),
        "seconds": seconds,
        "objectives": [_objective(objective, problem) for objective in search.objective],
        "sampler": search.sampler,
        "seed": search.seed,
        "batch_size": search.batch_size,
        "trials": len(trials),
        "evaluations": found.evaluated,
        "repeated": len(trials) - found.evaluated,
        "feasible": sum(assessment_of(trial).feasible for trial in trials),
        "sampler_seconds": found.timing.sampler,
        "evaluation_seconds": found.timing.evaluation,
        "constraints": [
            {
                "name": c.name,
                "unit": c.unit,
                "limit": c.limit,
                "sense": "at least" if c.at_least else "at most",
            }
            for c in question.constraints
        ],
        "classes": list(file.classes),
        "roi": roi,
        "frames": next((grid.frames for grid in found.grids.values()), 0),
        "zones": [
            {"name": zone.name, "polygon": zone.polygon, "z": zone.z}
            for zone in problem.space.zones
        ],
        "vehicle": question.carrier.vehicle.boxes.tolist(),
        "models": {
            name: {
                "price": question.carrier.prices[name],
                "beams": lidar.beams,
                "azimuth_steps": lidar.azimuth_steps,
            }
            for name, lidar in problem.models.items()
        },
        "bound": _bound(found, problem),
        "best": found.best if len(search.objective) > 1 else found.best[:1],
        "baseline": None if any(o.measured for o in search.objective) else found.baseline,
        "rigs": {name: _rig(own, found, problem) for name, own in found.judged.items()},
        "importance": importances(found.study) or None,
        "stride": {
            "azimuth_stride": search.azimuth_stride,
            "relative_error": stride_error(found.trials, list(found.judged.values())),
        },
        "tracking_uri": public_uri(file.tracking_uri),
        "versions": {"python": platform.python_version()} | {n: version(n) for n in _VERSIONS},
    }


def _objective(objective: ObjectiveSettings, problem: Problem) -> dict[str, Any]:
    weights = None
    if objective.by != "price":
        weights = objective.weights_of(problem.file.classes)
    return {
        "name": objective.name,
        "by": objective.by,
        "unit": "%" if objective.measured else _UNITS.get(objective.by, "nats"),
        "direction": objective.best,
        "weights": weights,
    }


def _rig(own: Judged, found: Found, problem: Problem) -> dict[str, Any]:
    values: Mapping[str, float] = own.assessment.values or {}
    if own.trial is not None:  # what was measured is known of the trial
        objectives = problem.file.search.objective
        trial = found.study.get_trials(deepcopy=False)[own.trial]
        measured = zip(objectives, trial.values, strict=True)
        values = {o.name: value for o, value in measured if o.measured} | dict(values)
    return {
        "role": own.role,
        "mounts": [list(astuple(lidar.mount)) for lidar in own.rig.lidars],
        "models": [lidar.model for lidar in own.rig.lidars],
        "zones": [lidar.zone or None for lidar in own.rig.lidars],
        "values": dict(values),
        "measures": own.assessment.measures,
    }


def _bound(found: Found, problem: Problem) -> dict[str, Any]:
    """How good the first objective can be; as the search computes it, with its azimuth stride."""
    certificate: Certificate | None = found.certificate
    if certificate is None:
        return {"value": None, "reason": found.no_certificate}
    best = found.trials[0].values[0] if found.trials else certificate.value
    return {
        "value": certificate.bound,
        "by_gains": certificate.by_gains,
        "greedy": certificate.value,
        "candidates": certificate.candidates,
        "best_value": best,
        "gap_percent": 100 * (1 - best / certificate.bound) if certificate.bound else 0.0,
        "reason": None,
    }


def _commands(problem: Problem, found: bool) -> list[dict[str, str]]:
    folder = problem.folder
    storage = problem.file.search.storage
    where = "DATABASE_URL" if storage else shlex.quote(str(journal_path(folder)))
    commands = [{"what": "look at all trials in a browser", "line": f"optuna-dashboard {where}"}]
    if found:
        quoted = shlex.quote(str(folder / "sweep.yaml"))
        rig = shlex.quote(str(folder / "placement.yaml"))
        commands += [
            {
                "what": "train detectors for it and for the paper's eight",
                "line": f"python -m sweeps.run {quoted}",
            },
            {
                "what": "see what it sees in a frame of a box log",
                "line": f"python -m lidarplace.view LOG --placement {rig}",
            },
        ]
    return commands


def _finite(value: Any) -> Any:
    """JSON knows neither NaN nor infinity: null."""
    if isinstance(value, Mapping):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
