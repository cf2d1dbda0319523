"""How predictors do in each kind of rigs: a mixture of kinds flatters them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from predicting import equal_budget, of, own_detectors, predictors, read, set_aside
from rig_results import SHORT, RigResults, head_of, label, number, table
from scipy import stats

from lidarplace import PAPER_PLACEMENTS
from tracking.findings.paired import with_sums
from tracking.findings.summary import surrogates_of
from tracking.statistics.confidence_interval import intervals

DRAWN = "expected_recall, drawn mounts"
SHIPPED = "pretrained"
"""The generalist of the package."""
OLD, NEW = "random, from scratch", "random, fine-tuned"
NAMES = {
    "generalist": "three generalists of the space",
    SHIPPED: "the package's generalist",
    DRAWN: "expected recall, drawn mounts",
}
PREDICTORS = (
    "generalist",
    SHIPPED,
    "expected_recall",
    DRAWN,
    "log_cells",
    "covered_entropy",
    "expected_ig",
    "expected_points",
)
TARGETS = ("car", "recall", "car_recall", "pedestrian_recall")
SUBSETS, OF = 4_000, 10
"""Random draws of so many rigs, among which a predictor takes the best."""


@cache
def populations() -> dict[str, list[str]]:
    """Rigs of each kind that have detectors of their own."""
    trained = [*own_detectors()["placement"].unique(), *set_aside()]
    four = equal_budget(trained)
    new = sorted(set(read("random_results")["placement"]) - set(PAPER_PLACEMENTS))
    return {
        "the paper's eight": [name for name in four if name in PAPER_PLACEMENTS],
        OLD: [name for name in four if name.startswith("random")],
        NEW: new,
        "optimised": [name for name in four if name.startswith("optimum")],
        "other LiDARs": [name for name in trained if name not in four],
    }


def population_table(target: str) -> str:
    """A row a predictor, a column a kind of rigs: Spearman's rho with 95 %."""
    rows = []
    for name in PREDICTORS:
        cells = [NAMES.get(name, label(name))]
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


def slope(predictor: str, target: str, kind: str) -> str:
    """Of what detectors reach on what is predicted, both percent (least squares)."""
    x, y = _both(predictor, target, kind)
    return number(float(np.polyfit(100 * x, y.mean(axis=1), 1)[0]))


def bias(predictor: str, target: str, kind: str) -> str:
    """What is predicted less what detectors reach, mean over rigs, points."""
    x, y = _both(predictor, target, kind)
    return number(float(100 * x.mean() - y.mean(axis=1).mean()), 1, sign=True)


def lost(predictor: str, target: str, kind: str) -> str:
    """Mean regret of taking the predictor's best of random draws of rigs, points."""
    x, y = _both(predictor, target, kind)
    if len(x) < OF:
        return "–"
    return number(_regret(x.to_numpy(np.float64), y.mean(axis=1).to_numpy(np.float64)), 1)


def calibration_table() -> str:
    """Slopes of measured recall on expected recall, with exact and with drawn mounts."""
    rows = []
    for target in ("car_recall", "pedestrian_recall"):
        for kind in (OLD, NEW):
            cells = [f"{head_of(target)}, {kind}"]
            for name in ("expected_recall", DRAWN):
                cells += [f(name, target, kind) for f in (rho, slope, bias)]
            rows.append(cells)
    return table(
        ["", *(f"{m}: {v}" for m in ("exact", "drawn") for v in ("ρ", "slope", "bias"))], rows
    )


def regret_table() -> str:
    """Mean regret by predictor among random rigs."""
    asked = [(target, kind) for target in ("car", "recall") for kind in (OLD, NEW)]
    rows = [
        [NAMES.get(name, label(name)), *(lost(name, target, kind) for target, kind in asked)]
        for name in PREDICTORS
    ]
    heads = [f"{head_of(target)}, {kind}" for target, kind in asked]
    return table(["", *heads], rows)


def steps_table() -> str:
    """What each step of a search's fidelity is worth on random rigs whose answer is known."""
    rows = []
    for words, values in STEPS.items():
        cells = [words]
        for target in ("car", "recall"):
            agree, loses = zip(*(_worth(x, y) for x, y in values(target)), strict=True)
            cells += [number(float(np.mean(agree))), number(float(np.mean(loses)), 1)]
        rows.append(cells)
    heads = [
        f"{head_of(target)}: {part}" for target in ("car", "recall") for part in ("ρ", "loses")
    ]
    return table(["", *heads], rows)


def _worth(x: pd.Series, y: pd.Series) -> tuple[float, float]:
    return float(stats.spearmanr(x, y).statistic), _regret(x.to_numpy(), y.to_numpy())


def _fine_tuned_rigs(target: str) -> pd.DataFrame:
    """What own detectors reach, a column a seed, of the random rigs that all steps have."""
    y = _reached(target, OLD)
    return y[y.index.isin(read("finetuned_results")["placement"])]


def _of_predictor(predictor: str, target: str) -> list[tuple[pd.Series, pd.Series]]:
    y = _fine_tuned_rigs(target)
    return [(_predicted(predictor, target, OLD).loc[y.index], y.mean(axis=1))]


def _of_table(name: str, target: str) -> list[tuple[pd.Series, pd.Series]]:
    y = _fine_tuned_rigs(target).mean(axis=1)
    rows = of(read(f"{name}_results"), SHORT[target])
    return [(rows.groupby("placement")["value"].mean().loc[y.index], y)]


def _of_one_seed(target: str) -> list[tuple[pd.Series, pd.Series]]:
    """A seed of the rig's own detectors against the mean of the others, each seed in turn."""
    y = _fine_tuned_rigs(target)
    return [(y[seed], y.drop(columns=seed).mean(axis=1)) for seed in y]


STEPS: dict[str, Callable[[str], list[tuple[pd.Series, pd.Series]]]] = {
    "expected recall": partial(_of_predictor, "expected_recall"),
    "the package's generalist, a quarter of the frames": partial(_of_table, "quarter"),
    "the same, all frames": partial(_of_table, "shipped"),
    "fine-tuned from a generalist, two seeds": partial(_of_table, "finetuned"),
    "trained from scratch, one seed": _of_one_seed,
}


def _regret(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    random = np.random.default_rng(0)
    draws = np.argsort(random.random((SUBSETS, len(x))), axis=1)[:, :OF]
    taken = draws[np.arange(SUBSETS), np.argmax(x[draws], axis=1)]
    return float((y[draws].max(axis=1) - y[taken]).mean())


@cache
def _both(predictor: str, target: str, kind: str) -> tuple[pd.Series, pd.DataFrame]:
    """What is predicted and what detectors reach, a row a rig that has both."""
    y = _reached(target, kind)
    x = _predicted(predictor, target, kind).reindex(y.index).dropna()
    return x, y.loc[x.index]


def _reached(target: str, kind: str) -> pd.DataFrame:
    rigs = populations()[kind]
    if kind == NEW:
        rows = read("random_results").query("evaluator == 'specialist'")
        rows = of(rows[rows["placement"].isin(rigs)], SHORT[target])
    else:
        rows = of(RigResults(rigs).results, SHORT[target])
    return rows.pivot(index="placement", columns="seed", values="value").dropna(axis=1)


def _predicted(predictor: str, target: str, kind: str) -> pd.Series:
    new = kind == NEW
    if predictor in ("generalist", SHIPPED):
        if new and predictor == "generalist":
            return pd.Series(dtype=np.float64)  # those of the space were not asked
        shipped = "random_results" if new else "shipped_results"
        rows = read("main_results" if predictor == "generalist" else shipped)
        rows = rows[rows["evaluator"] == predictor]
        return of(rows, SHORT[target]).groupby("placement")["value"].mean()
    object_class = SHORT[target][0]
    if predictor == DRAWN:
        own = read("random_drawn" if new else "drawn")
        wide = surrogates_of(with_sums(own), {}, object_class)
        return wide["expected_recall"]
    if new:
        wide = surrogates_of(with_sums(read("random_surrogates")), {}, object_class)
    else:
        known = predictors()
        kept = known[known["surrogate"] == predictor].drop(columns="target")
        wide = surrogates_of(with_sums(kept), {}, object_class)
    return wide[predictor] if predictor in wide else pd.Series(dtype=np.float64)


def rigs_of_steps() -> int:
    """How many rigs `steps_table` has."""
    return len(_fine_tuned_rigs("car"))


def of_tests() -> dict[str, int]:
    """How many test objects the new random rigs have by class."""
    return dict(read("random_individuals").set_index("class")["size"])
