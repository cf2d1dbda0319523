"""Placements that were promoted: by rungs of cheap stages to a full training; what that risked, and
what it saved."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import stats

from lidarplace.base.metrics import HEADLINE_METRIC
from tracking.findings.groups import at
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.findings.training_cost import is_longest
from tracking.kitti_iou import headline_iou
from tracking.labels import detector_label, metric_label, surrogate_name
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Rung
from tracking.statistics.coefficients import LARGEST_EXACT, permutation_p

FULL_TRAINING = "full training"
"""The stage after the last rung."""


@dataclass(frozen=True)
class Promoted:
    """The rungs and the full trainings of one detector at one setting of the further axes.

    Attributes:
        title: detector and setting.
        stages: what each rung ranked by, "expected IG (Car)"; FULL_TRAINING is the last.
        rungs: rows of `promotions.parquet`.
        trials: the full trainings that finished, rows of `trials.parquet`.
        seeds: seeds of the full trainings that were planned.
        ap: by placement, mean over seeds of the headline AP after full training, percent; of the
            class of the last rung, for "all" the mean over classes.
    """

    title: str
    stages: tuple[str, ...]
    rungs: pd.DataFrame
    trials: pd.DataFrame
    seeds: int
    ap: pd.Series

    @property
    def placements(self) -> int:
        """Placements that the first rung ranked."""
        return int((self.rungs["rung"] == self.rungs["rung"].min()).sum())


def fully_trained(run: RunFolder) -> RunFolder:
    """The run as if no training had been a shorter one."""
    full = is_full(run.results, run.axes, run.sweep.promote)
    return replace(run, results=run.results[full])


def is_full(table: pd.DataFrame, axes: Sequence[str], rungs: Sequence[Rung] = ()) -> pd.Series:
    """Whether each row belongs to the longest training and of none that a rung shortened.

    Args:
        table: trials or results, with the columns `axes`.
        rungs: `promote` of `sweep.json`: what each rung sets, by key path.
    """
    full = is_longest(table, axes)
    for rung in rungs:
        setting = {k: v for k, v in rung.set.items() if k in table and table[k].nunique() > 1}
        if setting:
            same = [table[key] == _cell(value) for key, value in setting.items()]
            full &= ~np.logical_and.reduce(same)
    return full


def _cell(value: object) -> object:
    """A value of the configuration as it stands in a table."""
    return value if isinstance(value, (int, float, str)) else json.dumps(value)


def promoted(
    promotions: pd.DataFrame,
    trials: pd.DataFrame,
    results: pd.DataFrame,
    axes: Sequence[str],
    rungs: Sequence[Rung],
) -> Iterator[Promoted]:
    """The groups of `promotions`, in its order.

    Args:
        promotions: `promotions.parquet`; those of `axes` that no rung sets are columns.
        trials: `trials.parquet`, with the short trainings.
        results: `results.parquet`, with those of the short trainings.
        rungs: `promote` of `sweep.json`.
    """
    full_trials = trials[is_full(trials, axes, rungs) & (trials["detector"] != "")]
    own = [axis for axis in axes if axis in promotions.columns]
    for values, part in promotions.groupby(["detector", *own], dropna=False, sort=False):
        place = dict(zip(("detector", *own), values, strict=True))
        planned = at(full_trials, place)
        finished = planned[planned["status"] == "finished"]
        part = part.sort_values(["rung", "rank"], kind="stable")
        yield Promoted(
            title=detector_label(own, place),
            stages=(*_stage_names(part, results), FULL_TRAINING),
            rungs=part,
            trials=finished,
            seeds=planned["seed"].nunique(),
            ap=_headline_ap(
                results[results["trial"].isin(finished["trial"])], str(part["class"].iloc[-1])
            ),
        )


def _headline_ap(results: pd.DataFrame, object_class: str) -> pd.Series:
    """Mean AP over seeds by placement; for "all" the mean over the classes with ground truth."""
    names = results["class"].unique() if object_class == "all" else [object_class]
    iou = {name: headline_iou(results, str(name)) for name in names}
    own = results[
        (results["metric"] == HEADLINE_METRIC) & (results["iou"] == results["class"].map(iou))
    ]
    return own.groupby(["placement", "class"])["value"].mean().groupby("placement").mean().dropna()


def _stage_names(rungs: pd.DataFrame, results: pd.DataFrame) -> Iterator[str]:
    for row in rungs.drop_duplicates("rung").to_dict("records"):
        by, object_class = str(row["by"]), str(row["class"])
        measured = by in results["metric"].to_numpy()
        name = metric_label(by, headline_iou(results, object_class, by)) if measured else by
        setting = str(row["setting"]).replace("training.", "").replace("=", " = ")
        yield f"{surrogate_name(name)} ({object_class})" + (f", {setting}" if setting else "")


def stage_ranks(group: Promoted) -> pd.DataFrame:
    """Rank of every placement, 1 the best: a row a placement, a column a rung, the last one the
    full training. NaN where a placement did not come that far or has no value."""
    known = group.rungs[group.rungs["value"].notna()]
    ranks = known.pivot(index="placement", columns="rung", values="rank").astype("float64")
    ranks = ranks.reindex(group.rungs["placement"].unique())
    ranks = ranks.reindex(columns=sorted(group.rungs["rung"].unique()))
    ranks.columns = pd.RangeIndex(len(ranks.columns))
    return ranks.assign(**{FULL_TRAINING: group.ap.rank(ascending=False, method="min")})


COLUMNS = (
    *("rung", "earlier", "later", "to_full", "n", "spearman", "spearman_p", "kendall", "kendall_p"),
    *("best", "best_rank", "ranked", "kept", "first", "first_rank", "regret", "seconds"),
)


def agreement(group: Promoted) -> pd.DataFrame:
    """How each stage ranked the placements that a later stage ranked too.

    Pairs of neighbouring rungs, and of each rung and the full training. Only placements that
    reached the later stage have both ranks. They were chosen by the earlier one, so their range is
    restricted: the agreement among them says little about the placements that were pruned.

    Returns:
        One row a pair: rung, the number of the earlier one from 1; earlier, later (names of
        stages); to_full, whether the later one is the full training; n placements with both;
        spearman, spearman_p, kendall, kendall_p (NaN for fewer than 3; see `_p_values`); best, of
        the later stage, and best_rank, its rank among all of the earlier one; ranked and kept, by
        the earlier stage; first, what the earlier stage ranked highest of the n, and first_rank,
        its rank there; regret, how much worse `first` is than `best` in the later stage, in its
        own unit; seconds, mean of the earlier stage for a placement.
    """
    ranks = stage_ranks(group)
    last = len(group.stages) - 1
    values = [part.set_index("placement")["value"] for _, part in group.rungs.groupby("rung")]
    kept = group.rungs.groupby("rung")["kept"].sum().tolist()
    seconds = group.rungs.groupby("rung")["seconds"].mean().tolist()
    rows = []
    for i in range(last):
        for j in dict.fromkeys((i + 1, last)):
            both = ranks.iloc[:, [i, j]].dropna()
            if both.empty:
                continue
            earlier, later = (both.iloc[:, k] for k in (0, 1))
            best, first = str(later.idxmin()), str(earlier.idxmin())
            value = group.ap if j == last else values[j]
            rho, tau = rank_agreement(earlier, later)
            p_spearman, p_kendall = _p_values(earlier, later)
            rows.append(
                {
                    "rung": i + 1,
                    "earlier": group.stages[i],
                    "later": group.stages[j],
                    "to_full": j == last,
                    "n": len(both),
                    "spearman": rho,
                    "spearman_p": p_spearman,
                    "kendall": tau,
                    "kendall_p": p_kendall,
                    "best": best,
                    "best_rank": int(earlier[best]),
                    "ranked": int(ranks.iloc[:, i].notna().sum()),
                    "kept": int(kept[i]),
                    "first": first,
                    "first_rank": int(earlier[first]),
                    "regret": abs(value[best] - value[first]),
                    "seconds": seconds[i],
                }
            )
    return pd.DataFrame(rows, columns=COLUMNS)


def _p_values(a: pd.Series, b: pd.Series) -> tuple[float, float]:
    """Two-sided p-values of Spearman's rho and Kendall's tau; NaN for fewer than 3 or equal ones.

    From all permutations up to `LARGEST_EXACT` pairs. Beyond, thousands of placements may have
    both ranks: then scipy's, of rho by the t distribution, of tau exact or by the normal one.
    """
    if len(a) < 3 or a.nunique() == 1 or b.nunique() == 1:
        return np.nan, np.nan
    if len(a) > LARGEST_EXACT:
        return float(stats.spearmanr(a, b).pvalue), float(stats.kendalltau(a, b).pvalue)
    one, other = a.to_numpy()[None], b.to_numpy()
    return (
        float(permutation_p(one, other, "spearman")[0]),
        float(permutation_p(one, other, "kendall")[0]),
    )


def rung_costs(group: Promoted) -> pd.DataFrame:
    """One row a stage: stage, placements, without_value, kept, seconds, seconds_each.

    `seconds_each` is the mean over placements; the full training counts all seeds of one, and
    keeps none. Seconds of rungs are of their own tasks alone.
    """
    *names, last = group.stages
    rungs = group.rungs.assign(without_value=group.rungs["value"].isna()).groupby("rung")
    table = rungs.agg(
        placements=("placement", "size"),
        without_value=("without_value", "sum"),
        kept=("kept", "sum"),
        seconds=("seconds", "sum"),
        seconds_each=("seconds", "mean"),
    )
    reached = int(table["kept"].iloc[-1])
    spent = group.trials["seconds"]
    full = {
        "placements": reached,
        "without_value": reached - group.trials["placement"].nunique(),
        "kept": 0,
        "seconds": spent.sum(),
        "seconds_each": spent.mean() * group.seeds,
    }
    table = pd.concat([table, pd.DataFrame([full])], ignore_index=True)
    table.insert(0, "stage", [*names, last])
    return table


def savings(groups: Sequence[Promoted], surrogate_axes: Sequence[str]) -> pd.DataFrame:
    """Seconds that promotion spent, against full trainings of all placements.

    Without promotion every placement of the first rung would have had the surrogates of all
    surrogate rungs and a full training for every seed, at the mean seconds of those that were
    done. Point clouds are counted on neither side.

    Args:
        surrogate_axes: axes that surrogates depend on: groups that differ in others share them.

    Returns:
        One row a group, and one for all when there are several: group, placements, surrogates,
        short, full (seconds spent), spent, without (seconds, NaN if no full training finished),
        saved (without less spent).
    """
    rows, own = [], []
    for number, group in enumerate(groups):
        is_surrogate = group.rungs["setting"] == ""
        own.append(group.rungs[is_surrogate].assign(group=number))
        rows.append(
            {
                "group": group.title,
                "placements": group.placements,
                "short": group.rungs.loc[~is_surrogate, "seconds"].sum(),
                "full": group.trials["seconds"].sum(),
                "all_full": group.trials["seconds"].mean() * group.placements * group.seeds,
            }
        )
    table = pd.DataFrame(rows)
    surrogates = pd.concat(own)
    spent = surrogates.groupby("group")["seconds"].sum()
    of_rung = surrogates.groupby(["group", "rung"])["seconds"].mean().groupby("group").sum()
    table["surrogates"] = spent.reindex(table.index, fill_value=0.0)
    table["all_surrogates"] = of_rung.reindex(table.index, fill_value=0.0) * table["placements"]
    if len(table) > 1:
        total = table.drop(columns="group").sum(skipna=False)
        depends = [axis for axis in surrogate_axes if axis in surrogates.columns]
        once = surrogates.drop_duplicates([*depends, "rung", "placement"])
        total["surrogates"] = once["seconds"].sum()
        each = once.groupby([*depends, "rung"], dropna=False)["seconds"].mean()
        total["all_surrogates"] = each.sum() * table["placements"].max()
        table.loc[len(table)] = {"group": "all groups", **total}
    table["spent"] = table["surrogates"] + table["short"] + table["full"]
    table["without"] = table["all_surrogates"] + table["all_full"]
    table["saved"] = table["without"] - table["spent"]
    columns = ["group", "placements", "surrogates", "short", "full", "spent", "without", "saved"]
    return table[columns]
