"""Whether the surrogate's gain became AP: detectors for the winners and for the paper's rigs."""

import json
import math
from collections.abc import Mapping
from typing import Any

import pandas as pd
from rich.console import Console

from lidarplace.base.metrics import RANKING
from lidarplace.base.plugin_folders import plugin_folder
from lidarplace.command_line.verbs import wrong
from sweeps.configuration.grid import Sweep
from sweeps.plan.plan import read_plan
from sweeps.plan.trial import Plan
from sweeps.search.problem.problem import Problem
from sweeps.search.verification.winners import Found, Judged
from sweeps.store.open import store_of
from tracking.findings.best_placement import best_placement
from tracking.findings.summary import seed_means
from tracking.kitti_iou import headline_iou
from tracking.run_folders.search_tables import VERIFIED
from tracking.run_folders.sweep import RunFolder


def verify_found(console: Console, problem: Problem, found: Found, command: str) -> bool:
    """Run `sweep.yaml` of the run folder as a sweep, by the `command` of the search, and write
    `verified.parquet`. Returns whether all trainings finished."""
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
    surrogate = {name: own.value(objective) for name, own in found.judged.items()}
    table = verified_table(run.results, run.left_out, found.judged, surrogate, found.baseline)
    VERIFIED.write(table, problem.folder)
    return complete


def read_verification(problem: Problem) -> tuple[Sweep, Plan]:
    """The sweep that a search left in `sweep.yaml`, with the addresses of the search. Raises
    ConfigError: the file, which a user may have changed, is wrong."""
    whole = problem.file.model_dump(mode="json", include={"store", "tracking"})
    overrides = [f"{key}={json.dumps(value)}" for key, value in whole.items()]
    with plugin_folder(problem.path.parent):
        return read_plan(problem.folder / "sweep.yaml", overrides)


def verified_table(
    results: pd.DataFrame,
    left_out: pd.DataFrame | None,
    judged: Mapping[str, Judged],
    surrogate: Mapping[str, float],
    baseline: str,
    generalist: bool = False,
) -> pd.DataFrame:
    """Means and differences to the baseline, with the intervals of the sweep's own report.

    Those of the means are Student's (`tracking.findings.summary.seed_means`), those of the
    differences Tukey and Kramer's, which hold for all pairs of rigs at once
    (`tracking.findings.best_placement`). Both allow for the test routes and individuals where these
    are known, and are NaN where all have one seed.

    Args:
        results, left_out: of the sweep that measured them.
        surrogate: the objective's value of each rig.
        generalist: whether the same detectors judged all rigs.

    Returns rows of `VERIFIED`, the best first.
    """
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
        for name in (name for name in best.sure.index if name in judged):
            own = against.loc[name] if name in against.index and name != baseline else {}
            row = {"rig": name, "role": judged[name].role, **of, "value": mean.at[name, "mean"]}
            row |= {key: mean.at[name, key] for key in ("low", "high", "seeds")}
            row["difference"] = own.get("difference", math.nan)
            row |= {f"difference_{end}": own.get(end, math.nan) for end in ("low", "high")}
            rows.append(row | {"surrogate": surrogate[str(name)]})
    return pd.DataFrame(rows)


def _rows(table: pd.DataFrame, of: Mapping[str, Any]) -> pd.DataFrame:
    return table[(table[list(of)] == pd.Series(of)).all(axis=1)]
