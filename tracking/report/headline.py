"""The first lines of a report: what is best, do the surrogates agree, what to be careful about."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from tracking.correlation import FEW_PLACEMENTS
from tracking.labels import SURROGATES, interval, metric_label, signed, surrogate_name
from tracking.permutation import smallest_p
from tracking.report.groups import Group
from tracking.run_folder import RunFolder
from tracking.sampling_error import separated
from tracking.summary import deciding_surrogate, headline_iou, surrogates_of

HEADLINE_METRIC = "AP_R40_3D"
HEADLINE_SURROGATES = ("s_mig", "expected_ig", "m_sog", "expected_points", "covered_voxels")
"""Those with an order of their own: the others order placements as S-MIG or its negative."""

FEW_GROUND_TRUTHS = 200


@dataclass(frozen=True)
class Verdict:
    """What a group says about one class, as sentences."""

    object_class: str
    group: str
    metric: str
    best: str
    lead: str
    surrogates: tuple[str, ...]


def verdicts(
    run: RunFolder, group: Group, means: pd.DataFrame, correlations: pd.DataFrame
) -> list[Verdict]:
    """One verdict for every class that has AP.

    Args:
        means: `seed_means` of the run.
        correlations: `correlate` of the run.
    """
    found = []
    for name in run.classes:
        iou = headline_iou(run.results, name)
        same = (group.of(means), group.of(correlations))
        table, tests = (
            part[
                (part["class"] == name) & (part["metric"] == HEADLINE_METRIC) & (part["iou"] == iou)
            ]
            for part in same
        )
        table = table[table["seeds"] > 0].sort_values("mean", ascending=False)
        if table.empty:
            continue
        best = table.iloc[0]
        found.append(
            Verdict(
                name,
                group.title,
                metric_label(HEADLINE_METRIC, iou),
                str(best["placement"]),
                f"{plus_minus(best['mean'], best['sd'])} %{_lead(table)}",
                tuple(
                    _agreement(row)
                    for row in tests.to_dict("records")
                    if row["surrogate"] in HEADLINE_SURROGATES
                ),
            )
        )
    return found


def surrogate_verdicts(run: RunFolder, group: Group) -> list[Verdict]:
    """One verdict for every class of a sweep without results, by `deciding_surrogate`."""
    decides = deciding_surrogate(run.surrogates)
    found = []
    for name in run.classes:
        table = surrogates_of(run.surrogates, group.setting, name)
        if decides not in table.columns or not table[decides].notna().any():
            continue
        ranked = table[decides].dropna().sort_values(ascending=False, kind="stable")
        best, unit = str(ranked.index[0]), SURROGATES[decides][1]
        lead = f"{ranked.iloc[0]:,.5g} {unit}"
        if len(ranked) > 1 and ranked.iloc[1] > 0:
            ahead = 100 * (ranked.iloc[0] / ranked.iloc[1] - 1)
            lead += f", {ahead:.2g} % ahead of {ranked.index[1]}, of {len(ranked):,} placements"
        ranks = table.rank(ascending=False, method="min").loc[best]
        others = [s for s in HEADLINE_SURROGATES if s in table.columns and s != decides]
        found.append(
            Verdict(
                name,
                group.title,
                surrogate_name(decides),
                best,
                lead,
                tuple(
                    f"{surrogate_name(other)}: rank {ranks[other]:,.0f} from the highest"
                    for other in others
                    if not np.isnan(ranks[other])
                ),
            )
        )
    return found


def plus_minus(mean: float, sd: float) -> str:
    """Mean and standard deviation, "71.3 ± 0.9"; a dash for no number, no ± for a single seed."""
    if np.isnan(mean):
        return "–"
    shown = f"{round(mean, 1) + 0.0:.1f}".replace("-", "−")
    return shown if np.isnan(sd) else f"{shown} ± {sd:.1f}"


def _lead(table: pd.DataFrame) -> str:
    """The lead over the next placement, against the spread over seeds. `table` is sorted."""
    if len(table) < 2:
        return ""
    lead = table.iloc[0]["mean"] - table.iloc[1]["mean"]
    text = f", {lead:.1f} points ahead of {table.iloc[1]['placement']}"
    spread = float(np.sqrt((table["sd"] ** 2).mean()))
    if np.isnan(spread):
        return f"{text}; one seed, so the spread is unknown"
    # Standard error of a difference of two means over the same number of seeds.
    error = spread * np.sqrt(2 / table["seeds"].min())
    verdict = "separated" if lead > 2 * error else "not separated"
    return f"{text}: {verdict}, two standard errors over seeds are {2 * error:.1f}"


def _agreement(row: Mapping[Hashable, Any]) -> str:
    name = surrogate_name(str(row["surrogate"]))
    rho, low, high, p = (
        row[key] for key in ("spearman", "spearman_low", "spearman_high", "spearman_p")
    )
    if np.isnan(rho):
        return f"{name}: no coefficient, {row['note']}"
    numbers = f"ρ = {signed(rho)} {interval(low, high)}, p = {p:.2g}"
    if low <= 0 <= high or p > 0.05:
        return f"{name}: undecided, {numbers}"
    return f"{name} {'rises' if rho > 0 else 'falls'} with AP, {numbers}"


def warnings(run: RunFolder, means: pd.DataFrame) -> list[str]:
    """What makes the numbers of this run weak, one plain sentence each."""
    said = []
    failed = run.trials[run.trials["status"] == "failed"]
    if len(failed):
        first = str(failed["error"].iloc[0]).strip().splitlines()
        reason = f" The first error: {first[-1]}" if first else ""
        said.append(f"{len(failed)} of {len(run.trials)} trials did not finish.{reason}")
    if run.results.empty:
        detectors = (run.trials["detector"] != "").any()
        reason = "no detector was evaluated" if detectors else "the sweep has no detector"
        return [*said, f"There are no results: {reason}. Surrogates alone do not tell AP."]
    n = run.results["placement"].nunique()
    if n == 1:
        said.append("One placement: there is nothing to compare it with.")
    elif n < 3:
        said.append(f"{n} placements: a correlation needs at least 3.")
    elif n < FEW_PLACEMENTS:
        said.append(
            f"Only {n} placements: no two-sided p-value can be below {smallest_p(n):.2g}, and "
            "intervals are wide."
        )
    seeds = means.loc[means["seeds"] > 0, "seeds"]
    if len(seeds) and seeds.min() < 2:
        said.append("One seed: differences between placements may be chance of the training.")
    elif len(seeds) and seeds.min() < 3:
        said.append("Two seeds: the spread over seeds is itself uncertain.")
    counts = means[means["class"].isin(run.classes)].groupby("class")["ground_truths"].min()
    for name, count in counts.items():
        if count == 0:
            said.append(f"{name}: no ground truth in the test frames, so no AP.")
        elif count < FEW_GROUND_TRUTHS:
            said.append(f"{name}: only {count} ground truths in the test frames.")
    for name in run.classes:
        ap = means[(means["class"] == name) & means["metric"].str.startswith("AP_")]["mean"]
        if ap.notna().any() and ap.max() < 5:
            said.append(f"{name}: AP is below 5 % everywhere: the detector learned too little.")
    return said


def separation_sentences(pairs: pd.DataFrame, title: str) -> list[str]:
    """Does the POG's sampling error blur the ranking of the placements? None for one placement.

    Args:
        pairs: `tracking.sampling_error.paired_differences` of one class and setting.
        title: of the class and setting.
    """
    own = pairs[pairs["surrogate"].isin(HEADLINE_SURROGATES)]
    if own.empty:
        return []
    kept = separated(own).groupby(own["surrogate"], sort=False).agg(["sum", "size"])
    counts = [
        f"{surrogate_name(str(name))} {row['sum']} of {row['size']}"
        for name, row in kept.iterrows()
    ]
    blurred = bool((kept["sum"] < kept["size"]).any())
    verdict = "blurs" if blurred else "does not blur"
    return [
        f"{title}: the POG's sampling error {verdict} the ranking of the placements. Pairs whose "
        f"order other frames would keep (paired difference, 95 %): {', '.join(counts)}."
    ]
