"""How good predictors are: rank correlation, regret and pairs, by metric and population."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import pandas as pd

from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.benchmark.rigs import METRICS, of, populations, read
from tracking.findings.best_placement import BestPlacement, best_placement
from tracking.findings.ceiling import ceilings
from tracking.report.sections.regret import AT_RANDOM, regrets
from tracking.statistics.coefficients import scores as unit_vectors
from tracking.statistics.confidence_interval import intervals
from tracking.statistics.pair_agreement import pair_agreement
from tracking.statistics.reliability import seed_mean

_LOST = ("regret", "regret_low", "regret_high")
_ONE_SETTING = {"detector": "pointpillars_tiny", "difficulty": "all"}


@dataclass(frozen=True, eq=False)
class Reached:
    """What the own detectors of some rigs reached in one metric.

    Attributes:
        values: percent, a row a rig, a column a seed.
        best: the rigs against each other, with the noise of seeds and test objects.
        ceiling: Spearman's rho that a perfect predictor is expected to have with the means.
        seeds_agree: correlation of two seeds, ICC(3, 1).
    """

    values: pd.DataFrame
    best: BestPlacement
    ceiling: float
    seeds_agree: float


def scores(
    predicted: Mapping[str, pd.DataFrame], metrics: Sequence[str] = tuple(METRICS)
) -> pd.DataFrame:
    """A row for each predictor, population and metric.

    Args:
        predicted: a row a rig, a column for each of `METRICS`; NaN where a predictor has no value.
        metrics: of `METRICS`.

    Returns:
        predictor, population, metric; rigs, their number; rho, Spearman's with the means over
        seeds, and low and high, 95 %; ceiling and seeds_agree, see `Reached`; takes, the rig with
        the predictor's best value; regret, expected loss of it in points, with regret_low and
        regret_high; right, share of the pairs that differ by more than noise and that the predictor
        has in their order; pairs, their number. NaN where there is no number.
    """
    rows = [
        row
        for population, rigs in populations().items()
        for metric in metrics
        for row in _rows(predicted, reached(tuple(rigs), metric), population, metric)
    ]
    return pd.DataFrame(rows)


@cache
def reached(rigs: tuple[str, ...], metric: str) -> Reached:
    """What the own detectors of `rigs` reached in one of `METRICS`."""
    rows, left_out = (_among(of(read(name), metric), rigs) for name in ("reached", "left_out"))
    best = best_placement(rows, left_out=left_out)
    assert best is not None  # all were tested
    most = ceilings(rows.assign(**_ONE_SETTING), left_out.assign(**_ONE_SETTING)).iloc[0]
    values = rows.pivot(index="placement", columns="seed", values="value")
    return Reached(values, best, most["ceiling"], most["agreement_of_seeds"])


def regret_at_random(rigs: Sequence[str], metric: str) -> float:
    """Expected loss, in points, of any of `rigs`."""
    lost = regrets(reached(tuple(rigs), metric).best, pd.DataFrame(index=list(rigs)))
    return float(lost.loc[lost["surrogate"] == AT_RANDOM, "regret"].iloc[0])


def _among(table: pd.DataFrame, rigs: Sequence[str]) -> pd.DataFrame:
    return table[table["placement"].isin(rigs)]


def _rows(
    predicted: Mapping[str, pd.DataFrame], truth: Reached, population: str, metric: str
) -> list[dict[str, object]]:
    rigs = truth.values.index
    x = pd.DataFrame({name: own[metric].reindex(rigs) for name, own in predicted.items()})
    lost = {row["surrogate"]: row for row in regrets(truth.best, x).to_dict("records")}
    y = truth.values.to_numpy(np.float64)
    rows = []
    for name in predicted:
        own = x[name].to_numpy(np.float64)
        row: dict[str, object] = {"predictor": name, "population": population, "metric": metric}
        row |= {"rigs": len(rigs), "ceiling": truth.ceiling, "seeds_agree": truth.seeds_agree}
        row |= dict.fromkeys(("rho", "low", "high", *_LOST), np.nan)
        row |= {"takes": "", "right": np.nan, "pairs": 0}
        if np.isfinite(own).all():
            parts = (unit_vectors(part, "spearman") for part in (own, seed_mean(y)))
            row["rho"] = float(np.dot(*parts))
            row["low"], row["high"] = intervals(own, y, "spearman")
            known = SURROGATES.get(name)
            sense = -1 if known is not None and known.direction == "minimize" else 1
            ordered = sense * x[name].reindex(truth.best.sure.index).to_numpy(np.float64)
            row["right"], row["pairs"] = pair_agreement(ordered, truth.best.pairs)
        if name in lost:
            row["takes"] = lost[name]["choice"]
            row |= {key: lost[name][key.removeprefix("regret_")] for key in _LOST}
        rows.append(row)
    return rows
