"""Quality of predictors: rank correlation, regret and pairs, by metric and population."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

import numpy as np
import pandas as pd

from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.benchmark.rigs import METRICS, of, populations, read
from tracking.findings.best_placement import BestPlacement, best_placement
from tracking.findings.ceiling import ceilings
from tracking.report.sections.regret import regrets
from tracking.statistics.all_pairs import pair_agreement
from tracking.statistics.coefficients import scores as unit_vectors
from tracking.statistics.confidence_interval import intervals
from tracking.statistics.reliability import seed_mean

_LOST = ("regret", "regret_low", "regret_high")
_ONE_SETTING = {"detector": "pointpillars_tiny", "difficulty": "all"}


def scores(
    predicted: Mapping[str, pd.DataFrame], metrics: Sequence[str] = tuple(METRICS)
) -> pd.DataFrame:
    """Score predictors, a row for each metric, population and predictor.

    Args:
        predicted: a row a rig, a column for each of `METRICS`; NaN where a predictor has no value.
        metrics: of `METRICS`.

    Returns:
        metric, population, predictor; rigs, their number; ceiling, the rho of a perfect predictor,
        and seeds_agree, ICC(3, 1); rho, Spearman's with the means over seeds, low and high, 95 %;
        takes, the rig with the predictor's best value, regret, its expected loss in points, and
        regret_low and regret_high; right, see `pair_agreement`, and pairs, their number. NaN where
        there is no number."""
    every = [(metric, name) for metric in metrics for name in populations()]
    return pd.DataFrame([row for group in every for row in _rows(predicted, *group)])


@cache
def reached(metric: str, population: str) -> tuple[pd.DataFrame, BestPlacement, dict[str, float]]:
    """Return percent, a row a rig, a column a seed; the rigs compared; and `ceilings` of them."""
    tables = (of(read(name), metric) for name in ("reached", "left_out"))
    rows, left_out = (t[t["placement"].isin(populations()[population])] for t in tables)
    best = best_placement(rows, left_out=left_out)
    assert best is not None  # all were tested
    most = ceilings(rows.assign(**_ONE_SETTING), left_out.assign(**_ONE_SETTING))
    noise = {"ceiling": most["ceiling"][0], "seeds_agree": most["agreement_of_seeds"][0]}
    return rows.pivot(index="placement", columns="seed", values="value"), best, noise


def _rows(
    predicted: Mapping[str, pd.DataFrame], metric: str, population: str
) -> Iterator[dict[str, object]]:
    values, best, most = reached(metric, population)
    y = values.to_numpy(np.float64)
    x = pd.DataFrame(
        {name: table[metric].reindex(values.index) for name, table in predicted.items()}
    )
    lost = {row["surrogate"]: row for row in regrets(best, x).to_dict("records")}
    for name in predicted:
        row: dict[str, object] = {"metric": metric, "population": population, "predictor": name}
        row |= {"rigs": len(y), **most, "takes": "", "right": np.nan, "pairs": 0}
        row |= dict.fromkeys(("rho", "low", "high", *_LOST), np.nan)
        scores = x[name].to_numpy(np.float64)
        if np.isfinite(scores).all():
            row["rho"] = unit_vectors(scores, "spearman") @ unit_vectors(seed_mean(y), "spearman")
            row["low"], row["high"] = intervals(scores, y, "spearman")
            surrogate = SURROGATES.get(name)
            sense = -1 if surrogate is not None and surrogate.direction == "minimize" else 1
            ordered = sense * x[name].reindex(best.sure.index).to_numpy(np.float64)
            row["right"], row["pairs"] = pair_agreement(ordered, best.pairs)
        if name in lost:
            row["takes"] = lost[name]["choice"]
            row |= {key: lost[name][key.removeprefix("regret_")] for key in _LOST}
        yield row
