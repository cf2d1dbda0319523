"""How predictors do in each kind of rigs: a mixture of kinds flatters them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
from judged import SHORT, Judged, head_of, label, number, table
from numpy.typing import NDArray
from predicting import equal_budget, of, own_detectors, predictors, read, set_aside
from scipy import stats

from lidarplace import PAPER_PLACEMENTS
from tracking.findings.paired import with_sums
from tracking.findings.summary import surrogates_of
from tracking.statistics.confidence_interval import intervals

RANDOM = "random"
PREDICTORS = (
    "generalist",
    "expected_recall",
    "log_cells",
    "covered_entropy",
    "expected_ig",
    "expected_points",
)
SUBSETS, OF = 4_000, 10
"""Random draws of so many rigs, among which a predictor takes the best."""


@cache
def populations() -> dict[str, list[str]]:
    """Rigs of each kind that have detectors of their own."""
    trained = [*own_detectors()["placement"].unique(), *set_aside()]
    four = equal_budget(trained)
    return {
        "the paper's eight": [name for name in four if name in PAPER_PLACEMENTS],
        RANDOM: [name for name in four if name.startswith("random")],
        "optimised": [name for name in four if name.startswith("optimum")],
        "other LiDARs": [name for name in trained if name not in four],
    }


def population_table(target: str) -> str:
    """A row a predictor, a column a kind of rigs: Spearman's rho with 95 %."""
    rows = []
    for name in PREDICTORS:
        cells = [label(name)]
        cells += [interval(name, target, kind) for kind in populations()]
        rows.append(cells)
    heads = [f"{kind} ({len(rigs)})" for kind, rigs in populations().items()]
    return table([head_of(target), *heads], rows)


def interval(predictor: str, target: str, kind: str) -> str:
    """Spearman's rho in a kind of rigs, with 95 %; a dash where it is not known."""
    x, y = _both(predictor, target, kind)
    if len(x) < 4:
        return "–"
    rho = stats.spearmanr(x, y.mean(axis=1)).statistic
    low, high = intervals(x.to_numpy(np.float64), y.to_numpy(np.float64), "spearman")
    return f"{number(rho)} ({number(low)} to {number(high)})"


def rho(predictor: str, target: str, kind: str) -> str:
    """Spearman's rho in a kind of rigs."""
    x, y = _both(predictor, target, kind)
    return number(stats.spearmanr(x, y.mean(axis=1)).statistic)


def lost(predictor: str, target: str, kind: str) -> str:
    """Mean regret of taking the predictor's best of random draws of rigs, points."""
    x, y = _both(predictor, target, kind)
    return number(_regret(x.to_numpy(np.float64), y.mean(axis=1).to_numpy(np.float64)), 1)


def regret_table() -> str:
    """Mean regret by predictor among random rigs."""
    rows = [[label(n), lost(n, "car", RANDOM), lost(n, "recall", RANDOM)] for n in PREDICTORS]
    return table(["", head_of("car"), head_of("recall")], rows)


def _regret(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    random = np.random.default_rng(0)
    draws = np.argsort(random.random((SUBSETS, len(x))), axis=1)[:, :OF]
    taken = draws[np.arange(SUBSETS), np.argmax(x[draws], axis=1)]
    return float((y[draws].max(axis=1) - y[taken]).mean())


@cache
def _both(predictor: str, target: str, kind: str) -> tuple[pd.Series, pd.DataFrame]:
    """What is predicted and what detectors reach, a row a rig that has both."""
    y = _reached(target, kind)
    x = _predicted(predictor, target).reindex(y.index).dropna()
    return x, y.loc[x.index]


def _reached(target: str, kind: str) -> pd.DataFrame:
    rows = of(Judged(populations()[kind]).results, SHORT[target])
    return rows.pivot(index="placement", columns="seed", values="value").dropna(axis=1)


def _predicted(predictor: str, target: str) -> pd.Series:
    if predictor == "generalist":
        rows = read("main_results").query("judge == 'generalist'")
        return of(rows, SHORT[target]).groupby("placement")["value"].mean()
    known = predictors()
    kept = known[known["surrogate"] == predictor].drop(columns="target")
    return surrogates_of(with_sums(kept), {}, SHORT[target][0])[predictor]
