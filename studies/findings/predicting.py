"""How well numbers that need no training tell what a rig's own detectors reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from candidates import FOLDER
from distil import TABLES, TARGETS
from properties import properties

from lidarplace.configuration.renamed_keys import current_key
from tracking.findings.best_placement import BestPlacement, best_placement
from tracking.findings.ceiling import ceilings
from tracking.findings.correlation import correlate
from tracking.findings.paired import with_sums
from tracking.findings.summary import surrogates_of
from tracking.report.sections.regret import regrets
from tracking.statistics.confidence_interval import strength_leads

Target = tuple[str, str, float]

GENERALIST = "generalist"
PREDICTORS = (
    GENERALIST,
    "expected_recall",
    "log_points",
    "log_cells",
    "enough_points",
    "covered_entropy",
    "ig",
    "m_sog",
    "covered_voxels",
    "expected_points",
    "expected_ig",
    "expected_ig, occluded",
    "mean height",
)
"""S-MIG is covered entropy with the other sign; h_pog is the same for all rigs."""
_ONE_SETTING = {"detector": "pointpillars_tiny", "difficulty": "all"}


@cache
def read(name: str) -> pd.DataFrame:
    """A table of `distil.py`."""
    return pd.read_parquet(TABLES / f"{name}.parquet").rename(columns=current_key)


def set_aside() -> list[str]:
    """Rigs that were set aside before anything was trained."""
    return (FOLDER / "set_aside.txt").read_text(encoding="utf-8").split()


def own_detectors(rigs: Sequence[str] | None = None) -> pd.DataFrame:
    """Rows of detectors trained for their rig: those named, or all of the design not set aside.

    A rig of `later.yaml` is there only where it is named.
    """
    rows = _with_later("results") if rigs else read("main_results")
    rows = rows[rows["evaluator"] == "specialist"]
    kept = rows["placement"].isin(rigs) if rigs else ~rows["placement"].isin(set_aside())
    return rows[kept]


def equal_budget(rigs: Sequence[str]) -> list[str]:
    """Those with four spinning LiDARs of 16 beams."""
    lidars = properties()
    four = (lidars["lidars"] == 4) & (lidars["beams"] == 64) & lidars["spinning"]
    return [name for name in rigs if four[name]]


def of(rows: pd.DataFrame, target: Target) -> pd.DataFrame:
    """Rows of one class, metric and IoU."""
    object_class, metric, iou = target
    same = (rows["class"] == object_class) & (rows["metric"] == metric)
    return rows[same & np.isclose(rows["iou"], iou)]


def named(target: Target) -> str:
    """A target in a word, as the tables' key."""
    return "{} {} {:g}".format(*target)


@cache
def predictors() -> pd.DataFrame:
    """placement, class, surrogate, value, and target where a predictor is of one target alone."""
    own = read("surrogates")
    height = properties()["mean height"].rename("value").reset_index()
    heights = [
        height.assign(**{"class": name, "surrogate": "mean height"})
        for name in (*own["class"].unique(), "all")
    ]
    judged = read("main_results").query("evaluator == 'generalist'")
    means = [
        of(judged, target)
        .groupby("placement", as_index=False)["value"]
        .mean()
        .assign(**{"class": target[0], "surrogate": GENERALIST, "target": named(target)})
        for target in TARGETS
    ]
    table = pd.concat([own, read("occluded"), *heights, *means], ignore_index=True)
    return table[table["surrogate"].isin(PREDICTORS)].drop_duplicates(
        ["placement", "class", "surrogate", "target"]
    )


@cache
def every_predictor(target: Target) -> pd.DataFrame:
    """A row a rig, a column each of PREDICTORS that has a value for the target."""
    summed = with_sums(predictors(), ["target"])
    wide = surrogates_of(summed, {"target": named(target)}, target[0])
    return wide[[name for name in PREDICTORS if name in wide.columns]]


def own_surrogates(name: str, target: Target) -> pd.DataFrame:
    """A row a rig, a column a surrogate, of tables of other scenes or rigs than the main one."""
    return surrogates_of(with_sums(read(f"{name}_surrogates")), {}, target[0])


def coefficients(results: pd.DataFrame) -> pd.DataFrame:
    """`correlate` of all targets at once, so that p-values know of all tests.

    Args:
        results: rows of `own_detectors`.
    """
    rows = _with_target(results)
    return correlate(rows, predictors(), ["target"]).set_index(["surrogate", "target"])


def most(results: pd.DataFrame) -> pd.DataFrame:
    """`ceilings` by target: what a perfect predictor could reach."""
    rows, left_out = _with_target(results), _with_target(_left_out(results))
    return ceilings(rows, left_out, ["target"]).set_index("target")


def best(results: pd.DataFrame, target: Target) -> BestPlacement:
    """The rigs by one target, with the noise of seeds and test objects."""
    found = best_placement(of(results, target), left_out=of(_left_out(results), target))
    if found is None:
        raise ValueError(f"no detector was tested for {named(target)}")
    return found


def _all(rows: pd.DataFrame) -> pd.DataFrame:
    return rows


def by_generalist(
    name: str, target: Target, kept: Callable[[pd.DataFrame], pd.DataFrame] = _all
) -> BestPlacement:
    """Rigs by one target, judged by one generalist, with the noise of the test objects.

    Args:
        name: of the tables.
        kept: their rows that matter; all by default.
    """
    return _judged(name, target, kept, generalist=True)


def by_own(name: str, target: Target) -> BestPlacement:
    """Rigs by one target, judged by detectors of their own, with the noise of seeds and objects.

    Args:
        name: of the tables.
    """
    return _judged(name, target, _all, generalist=False)


def _judged(
    name: str, target: Target, kept: Callable[[pd.DataFrame], pd.DataFrame], generalist: bool
) -> BestPlacement:
    results, left_out = (
        kept(of(read(f"{name}_{kind}"), target)) for kind in ("results", "left_out")
    )
    found = best_placement(results, left_out=left_out, generalist=generalist)
    if found is None:
        raise ValueError(f"no rig of {name} was judged for {named(target)}")
    return found


def regret(results: pd.DataFrame, target: Target) -> pd.DataFrame:
    """`regrets` by predictor: what is lost by following it."""
    return regrets(best(results, target), every_predictor(target)).set_index("surrogate")


def behind(results: pd.DataFrame, target: Target, name: str = GENERALIST) -> pd.DataFrame:
    """By how much the |rho| of the others is below that of `name`: 95 %, for all at once."""
    wide = every_predictor(target)
    y = of(results, target).pivot(index="placement", columns="seed", values="value")
    others = [one for one in wide.columns if one != name]
    x = wide.loc[y.index, [name, *others]].to_numpy(np.float64).T
    bounds = strength_leads(x, y.to_numpy(np.float64))
    return pd.DataFrame(bounds, others, ["low", "high"])


def _with_later(kind: str) -> pd.DataFrame:
    return pd.concat([read(f"main_{kind}"), read(f"later_{kind}")], ignore_index=True)


def _left_out(results: pd.DataFrame) -> pd.DataFrame:
    rows = _with_later("left_out")
    same = rows["evaluator"].isin(results["evaluator"].unique())
    return rows[same & rows["placement"].isin(results["placement"].unique())]


def _with_target(rows: pd.DataFrame) -> pd.DataFrame:
    columns: dict[str, Any] = {"target": _targets(rows), **_ONE_SETTING}
    return rows.drop(columns="evaluator").assign(**columns)


def _targets(rows: pd.DataFrame) -> list[str]:
    keys = zip(rows["class"], rows["metric"], rows["iou"].round(6), strict=True)
    return [named(key) for key in keys]
