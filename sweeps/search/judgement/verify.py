"""Whether the surrogate's gain became AP: detectors for the winners and for the paper's rigs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
from rich.console import Console
from scipy import stats

from lidarplace.command_line.verbs import wrong
from lidarplace.files.atomic import replacing
from lidarplace.metrics import RANKING
from sweeps.configuration.grid import Sweep
from sweeps.plan.plan import Plan, read_plan
from sweeps.search.judgement.found import Found
from sweeps.search.judgement.winners import Judged
from sweeps.search.problem.problem import Problem
from sweeps.store.of_sweep import store_of
from tracking.kitti_iou import headline_iou
from tracking.run_folders.sweep import RunFolder

_LEVEL = 0.95


def verify_found(console: Console, problem: Problem, found: Found, command: str) -> bool:
    """Run `sweep.yaml` of the run folder as a sweep, and write `verified.parquet`.

    Args:
        command: that of the search, which makes the sweep too.

    Returns:
        Whether all trainings finished.
    """
    from sweeps.run import run_sweep

    try:
        sweep, plan = read_verification(problem)
        store = store_of(sweep)
    except ValueError as error:
        wrong(error)
    complete = run_sweep(console, sweep, plan, store, command, rerun_failed=False)
    folder = sweep.common.output / sweep.common.name
    if not (folder / "results.parquet").exists():
        return False
    results = RunFolder.read(folder).results
    if results.empty:
        return False
    objective = problem.file.search.objective[0]
    known = not objective.measured
    surrogate = {
        name: own.value(objective) if known else math.nan for name, own in found.judged.items()
    }
    table = verified_table(results, found.judged, surrogate, found.baseline)
    with replacing(problem.folder / "verified.parquet") as partial:
        table.to_parquet(partial, index=False)
    return complete


def read_verification(problem: Problem) -> tuple[Sweep, Plan]:
    """The sweep that a search left in `sweep.yaml`, with the addresses of the search.

    Raises:
        ConfigError: the file, which a user may have changed, is wrong.
    """
    whole = problem.file.model_dump(mode="json", include={"store", "tracking"})
    overrides = [f"{key}={json.dumps(value)}" for key, value in whole.items()]
    return read_plan(problem.folder / "sweep.yaml", overrides)


def verified_table(
    results: pd.DataFrame,
    judged: Mapping[str, Judged],
    surrogate: Mapping[str, float],
    baseline: str,
) -> pd.DataFrame:
    """Means over seeds with Student's intervals, and differences to the baseline by seed.

    Trainings of one seed see the same frames in the same order under every rig, so differences are
    taken seed by seed; their interval is that of a paired t-test (95 %, n - 1 degrees of freedom).

    Args:
        results: rows of a sweep's `results.parquet`.
        judged: rigs by name.
        surrogate: the objective's value of each.
        baseline: the rig that others are compared with.

    Returns:
        rig, role, class, metric, iou, value, low, high, seeds, difference, difference_low,
        difference_high, surrogate. Intervals are NaN for one seed.
    """
    rows = []
    for (object_class, metric), own in results.groupby(["class", "metric"], sort=False):
        if metric not in RANKING:
            continue
        own = own[own["iou"] == headline_iou(own, str(object_class))]
        by_seed = own.pivot_table(index="seed", columns="placement", values="value")
        for name in by_seed.columns:
            if name not in judged:
                continue
            values = by_seed[name].dropna()
            mean, half = _interval(values.to_numpy())
            difference, spread = math.nan, math.nan
            if baseline in by_seed and name != baseline:
                pairs = (by_seed[name] - by_seed[baseline]).dropna()
                difference, spread = _interval(pairs.to_numpy())
            rows.append(
                {
                    "rig": name,
                    "role": judged[name].role,
                    "class": object_class,
                    "metric": metric,
                    "iou": own["iou"].iloc[0],
                    "value": mean,
                    "low": mean - half,
                    "high": mean + half,
                    "seeds": len(values),
                    "difference": difference,
                    "difference_low": difference - spread,
                    "difference_high": difference + spread,
                    "surrogate": surrogate[str(name)],
                }
            )
    return pd.DataFrame(rows)


def _interval(values: np.ndarray) -> tuple[float, float]:
    """Mean, and half the width of Student's interval; NaN for fewer than two values."""
    if len(values) == 0:
        return math.nan, math.nan
    if len(values) == 1:
        return float(values[0]), math.nan
    error = float(stats.sem(values))
    return float(values.mean()), float(stats.t.ppf((1 + _LEVEL) / 2, len(values) - 1)) * error
