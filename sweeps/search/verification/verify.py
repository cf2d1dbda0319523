"""Verification of a surrogate's gain by detectors, trained for the winners and the paper's rigs."""

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd
from rich.console import Console

from lidarplace.base.errors import at
from lidarplace.base.metrics import RANKING
from lidarplace.base.plugin_folders import plugin_folder
from lidarplace.command_line.verbs import wrong
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import Sweep, read_sweep
from sweeps.plan.plan import make_plan
from sweeps.plan.trial import Plan
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.verification.winners import AssessedRig, SearchFindings
from sweeps.store.open import store_of
from tracking.findings.best_placement import best_placement
from tracking.findings.summary import seed_means
from tracking.kitti_iou import headline_iou
from tracking.run_folders.search_tables import VERIFIED
from tracking.run_folders.sweep import RunFolder


def verify_found(
    console: Console, problem: SearchProblem, findings: SearchFindings, command: str
) -> bool:
    """Run `sweep.yaml` of the run folder as a sweep and write `verified.parquet`.

    `command`: that of the search. Returns whether all trainings finished."""
    from sweeps.run_sweep import run_sweep

    try:
        sweep, plan = read_verification(problem)
        store = store_of(sweep)
    except ValueError as error:
        wrong(error)
    complete = run_sweep(console, sweep, plan, store, command, rerun_failed=False)
    folder = sweep.common.output / sweep.common.name
    if not (folder / "results.parquet").exists():
        return False
    run = RunFolder.read(folder)
    if run.results.empty:
        return False
    objective = problem.file.search.objective[0]
    surrogate = {name: rig.value(objective) for name, rig in findings.rigs.items()}
    table = verified_table(run.results, run.left_out, findings.rigs, surrogate, findings.baseline)
    VERIFIED.write(table, problem.folder)
    return complete


def read_verification(problem: SearchProblem) -> tuple[Sweep, Plan]:
    """Read the sweep that a search left in `sweep.yaml`, with the addresses of the search.

    Raises ConfigError: the file, which a user may have changed, is wrong."""
    path = problem.folder / "sweep.yaml"
    addresses = problem.file.model_dump(mode="json", include={"store", "tracking"})
    with plugin_folder(problem.path.parent):
        sweep = read_sweep(path, changes=addresses)
        with at(path, ConfigError):
            return sweep, make_plan(sweep)


def verified_table(
    results: pd.DataFrame,
    left_out: pd.DataFrame | None,
    rigs: Mapping[str, AssessedRig],
    surrogate: Mapping[str, float],
    baseline: str,
    generalist: bool = False,
) -> pd.DataFrame:
    """Return means and differences to the baseline, with the intervals of the sweep's own report.

    Those of the means are Student's (`tracking.findings.summary.seed_means`), those of the
    differences Tukey and Kramer's, which hold for all pairs of rigs at once
    (`tracking.findings.best_placement`). Both allow for the test routes and individuals where these
    are known, and are NaN where all have one seed.

    Args:
        results: of the sweep that measured the rigs.
        left_out: the same without each unit of test objects.
        rigs: by name; others are left out.
        surrogate: the objective's value of each rig.
        baseline: name of the rig that others are compared with.
        generalist: whether the same detectors evaluated all rigs.

    Returns rows of `VERIFIED`, the best first."""
    means = seed_means(results, left_out=left_out)
    rows = []
    for (object_class, metric), every in results.groupby(["class", "metric"], sort=False):
        if metric not in RANKING:
            continue
        iou = headline_iou(every, str(object_class), str(metric))
        of = {"class": object_class, "metric": metric, "iou": iou}
        own_left_out = None if left_out is None else _rows(left_out, of)
        best = best_placement(_rows(every, of), left_out=own_left_out, generalist=generalist)
        if best is None:
            continue
        mean = _rows(means, of).set_index("placement")
        against = best.differences(baseline) if baseline in best.sure.index else pd.DataFrame()
        for name in (name for name in best.sure.index if name in rigs):
            difference = against.loc[name] if name in against.index and name != baseline else {}
            row = {"rig": name, "role": rigs[name].role, **of, "value": mean.at[name, "mean"]}
            row |= {key: mean.at[name, key] for key in ("low", "high", "seeds")}
            row["difference"] = difference.get("difference", math.nan)
            row |= {f"difference_{end}": difference.get(end, math.nan) for end in ("low", "high")}
            rows.append(row | {"surrogate": surrogate[str(name)]})
    return pd.DataFrame(rows)


def _rows(table: pd.DataFrame, of: Mapping[str, Any]) -> pd.DataFrame:
    return table[(table[list(of)] == pd.Series(of)).all(axis=1)]
