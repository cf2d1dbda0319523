"""Ranking of surrogates by how well they predict a metric, and whether any does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tracking.findings.paired import Paired, group_columns, paired
from tracking.labels import metric_label, signed, surrogate_name
from tracking.statistics.coefficients import distinct_tests, smallest_p
from tracking.statistics.confidence_interval import strength_leads

SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Predictors:
    """Surrogates of one group, a value of each of `group_columns`, the strongest first.

    Attributes:
        group: the group.
        ranking: index surrogate: `spearman`, its `p` and family-wise `holm`, `rmse` and
            `rmse_of_mean` of predicting a placement left out; `same_as`, the surrogate before it
            that orders placements alike or reversed, or ""; `behind`, by how much its |rho| is
            below the first one's, with `behind_low` and `behind_high`, a 95 % interval for all at
            once without the seeds' noise; NaN for the first, and for those that order alike.
        predictor: the strongest whose `holm` is below 0.05 and whose `rmse` is below
            `rmse_of_mean`; "" if there is none.
        sentence: the finding."""

    group: dict[str, object]
    ranking: pd.DataFrame
    predictor: str
    sentence: str


def best_surrogates(
    results: pd.DataFrame,
    surrogates: pd.DataFrame,
    correlations: pd.DataFrame,
    left_out: pd.DataFrame,
    axes: Sequence[str] = (),
) -> list[Predictors]:
    """Rank the surrogates of every group by the strength of their rank correlation.

    `correlations` and `left_out` are `correlate` and `leave_one_out` of `results`, `surrogates` and
    `axes`, see `paired`, whose errors it raises. One per group in which some surrogate has a
    coefficient, in the order of `correlations`."""
    keys = [*group_columns(axes), "surrogate"]
    estimates = correlations.merge(left_out[[*keys, "rmse", "rmse_of_mean"]], on=keys, how="left")
    predictors, start = [], 0
    for group in paired(results, surrogates, axes):
        of_group = estimates.iloc[start : start + group.surrogates.shape[1]]
        start += len(of_group)
        ranking = _ranking(group, of_group)
        if ranking.empty:
            continue
        proven = ranking["holm"] < SIGNIFICANT
        useful = ranking["rmse"] < ranking["rmse_of_mean"]
        both = ranking.index[proven & useful]
        predictor = str(both[0]) if len(both) else ""
        sentence = _sentence(group.group, ranking, predictor) + _beyond_proof(of_group)
        predictors.append(Predictors(group.group, ranking, predictor, sentence))
    return predictors


def _ranking(group: Paired, estimates: pd.DataFrame) -> pd.DataFrame:
    columns = ["spearman", "spearman_p", "spearman_holm", "rmse", "rmse_of_mean"]
    with_values = estimates[estimates["spearman"].notna()].set_index("surrogate")[columns]
    if with_values.empty:
        return with_values
    # Equal coefficients may differ by rounding: the order of the table decides between them.
    order = np.argsort(-with_values["spearman"].abs().round(9).to_numpy(), kind="stable")
    ranking = with_values.iloc[order].rename(columns={"spearman_p": "p", "spearman_holm": "holm"})
    ranking["same_as"] = ""
    ranking[["behind", "behind_low", "behind_high"]] = np.nan
    for placements, names in group.by_placements():
        ranked = [name for name in ranking.index if name in names]
        if not ranked:
            continue
        x = group.surrogates.loc[placements, ranked].to_numpy(np.float64).T
        same = [ranked[i] for i in distinct_tests(x, "spearman")]
        ranking.loc[ranked, "same_as"] = [
            "" if one == name else one for one, name in zip(same, ranked, strict=True)
        ]
        # Coefficients of other placements than the first one's cannot be compared with it.
        if ranked[0] != ranking.index[0]:
            continue
        # Those that order alike are one surrogate, also among the others.
        distinct = [i for i, one in enumerate(same) if one == ranked[i]]
        if len(distinct) < 2:
            continue
        y = group.metric.loc[placements].to_numpy(np.float64)
        bounds = strength_leads(x[distinct], y)
        leads = dict(zip([ranked[i] for i in distinct[1:]], bounds, strict=True))
        for name, one in zip(ranked, same, strict=True):
            if one in leads:
                behind = abs(ranking["spearman"].iloc[0]) - abs(ranking.loc[name, "spearman"])
                ranking.loc[name, ["behind", "behind_low", "behind_high"]] = [behind, *leads[one]]
    return ranking


def _sentence(group: dict[str, object], ranking: pd.DataFrame, predictor: str) -> str:
    objects = "All objects" if group["class"] == "all" else str(group["class"])
    about = f"{objects}, {metric_label(str(group['metric']), float(str(group['iou'])))}"
    surrogate = predictor or str(ranking.index[0])
    row = ranking.loc[surrogate].to_dict()
    numbers = f"ρ = {signed(row['spearman'])}, p = {row['holm']:.2g} after correction"
    error = (
        "too few placements to leave one out"
        if np.isnan(row["rmse"])
        else f"error of a placement left out {row['rmse']:.2g} points, of the mean "
        f"{row['rmse_of_mean']:.2g}"
    )
    name, evidence, comparison = surrogate_name(surrogate), f"({numbers}; {error})", ""
    if not predictor:
        return (
            f"{about}: no surrogate predicts it significantly. The strongest is {name} {evidence}."
        )
    if predictor == ranking.index[0]:  # which the others were compared with
        alike = ranking[(ranking["behind_low"] <= 0) & (ranking["same_as"] == "")].index
        names = ", ".join(surrogate_name(str(other)) for other in alike)
        comparison = names and f"; not significantly better than {names}"
    return f"{about}: {name} predicts it {evidence}{comparison}."


def _beyond_proof(estimates: pd.DataFrame) -> str:
    """Say where not even a perfect order could pass the correction."""
    n, tests = int(estimates["n"].max()), int(estimates["spearman_tests"].max())
    if smallest_p(n) * tests <= SIGNIFICANT:
        return ""
    return f" With {n} placements and {tests} tests not even a perfect order would be significant."
