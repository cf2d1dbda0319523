"""Promotion from cheap stages to a full training: what it risked and what it saved."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from lidarplace.base.metrics import HEADLINE_METRIC
from tracking.findings.groups import at
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.findings.training_cost import is_longest
from tracking.kitti_iou import headline_iou
from tracking.labels import detector_label, metric_label, surrogate_name
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Rung
from tracking.run_folders.table_schema import cell
from tracking.statistics.coefficients import permutation_p

FULL_TRAINING = "full training"  # the stage after the last rung


@dataclass(frozen=True)
class Promoted:
    """Rungs and full trainings of one detector at one setting of the further axes.

    Attributes:
        title: detector and setting.
        stages: what each rung ranked by, "rung 1: expected IG (Car)"; FULL_TRAINING is the last.
        rungs: rows of `promotions.parquet`.
        trials: the full trainings that finished, rows of `trials.parquet`.
        seeds: how many seeds of the full trainings were planned.
        ap: by placement, mean over seeds of the headline AP after full training, percent; of the
            class of the last rung, for "all" the mean over classes."""

    title: str
    stages: tuple[str, ...]
    rungs: pd.DataFrame
    trials: pd.DataFrame
    seeds: int
    ap: pd.Series

    @property
    def placements(self) -> int:
        """Number of placements that the first rung ranked."""
        return int((self.rungs["rung"] == self.rungs["rung"].min()).sum())


def fully_trained(run: RunFolder) -> RunFolder:
    """Keep the results of the longest trainings alone."""
    full = is_full(run.results, run.axes, run.sweep.promote)
    return replace(run, results=run.results[full])


def is_full(table: pd.DataFrame, axes: Sequence[str], rungs: Sequence[Rung] = ()) -> pd.Series:
    """Tell of each row whether it is of the longest training, which no rung shortened.

    `table` are trials or results, `rungs` those of `promote`."""
    full = is_longest(table, axes)
    for rung in rungs:
        setting = {k: v for k, v in rung.set.items() if k in table and table[k].nunique() > 1}
        if setting:
            full &= ~np.logical_and.reduce([table[k] == cell(v) for k, v in setting.items()])
    return full


def promoted(run: RunFolder) -> Iterator[Promoted]:
    """Yield the groups of `run.promotions`, in its order; `run` has the short trainings, too."""
    promotions, trials, results, axes = run.promotions, run.trials, run.results, run.axes
    if promotions is None:
        return
    full_trials = trials[is_full(trials, axes, run.sweep.promote) & (trials["detector"] != "")]
    columns = [axis for axis in axes if axis in promotions.columns]
    for values, part in promotions.groupby(["detector", *columns], dropna=False, sort=False):
        place = dict(zip(("detector", *columns), values, strict=True))
        planned = at(full_trials, place)
        finished = planned[planned["status"] == "finished"]
        part = part.sort_values(["rung", "rank"], kind="stable")
        of_full = results[results["trial"].isin(finished["trial"])]
        yield Promoted(
            title=detector_label(columns, place),
            stages=(*_stage_names(part, results), FULL_TRAINING),
            rungs=part,
            trials=finished,
            seeds=planned["seed"].nunique(),
            ap=_headline_ap(of_full, str(part["class"].iloc[-1])),
        )


def _headline_ap(results: pd.DataFrame, object_class: str) -> pd.Series:
    """Average AP over seeds by placement; for "all" the mean over the classes with ground truth."""
    names = results["class"].unique() if object_class == "all" else [object_class]
    iou = {name: headline_iou(results, str(name)) for name in names}
    headline = results[
        (results["metric"] == HEADLINE_METRIC) & (results["iou"] == results["class"].map(iou))
    ]
    return (
        headline.groupby(["placement", "class"])["value"]
        .mean()
        .groupby("placement")
        .mean()
        .dropna()
    )


def _stage_names(rungs: pd.DataFrame, results: pd.DataFrame) -> Iterator[str]:
    for i, row in enumerate(rungs.drop_duplicates("rung").to_dict("records"), start=1):
        by, object_class = str(row["by"]), str(row["class"])
        measured = by in results["metric"].to_numpy()
        name = metric_label(by, headline_iou(results, object_class, by)) if measured else by
        setting = str(row["setting"]).replace("training.", "").replace("=", " = ")
        label = f"rung {i}: {surrogate_name(name)} ({object_class})"
        yield f"{label}, {setting}" if setting else label


def stage_ranks(group: Promoted) -> pd.DataFrame:
    """Rank every placement, 1 the best: a column a rung, the last the full training.

    NaN where a placement did not come that far or has no value."""
    ranks = group.rungs.pivot(index="placement", columns="rung", values="rank").astype("float64")
    valued = group.rungs.pivot(index="placement", columns="rung", values="value").notna()
    ranks = ranks.where(valued).reindex(group.rungs["placement"].unique())
    ranks.columns = pd.RangeIndex(len(ranks.columns))
    return ranks.assign(**{FULL_TRAINING: group.ap.rank(ascending=False, method="min")})


def stages(group: Promoted) -> pd.DataFrame:
    """Compute what every stage cost, and how it ranked the placements that were trained in full.

    One row a stage: stage; placements; without_value; kept, 0 for the full training; seconds,
    of all of its tasks; seconds_each, the mean over placements, of the full training with all
    seeds of one. Of rungs, where a full training finished: n placements with both; spearman,
    its two-sided spearman_p (see `permutation_p`) and kendall; ranked, how many the rung ranked;
    best_rank, its rank of the best after full training; first, what it ranks highest of the n;
    regret, AP that the first is below the best."""
    rungs = group.rungs.assign(without_value=group.rungs["value"].isna()).groupby("rung")
    table = rungs.agg(
        placements=("placement", "size"),
        without_value=("without_value", "sum"),
        kept=("kept", "sum"),
        seconds=("seconds", "sum"),
        seconds_each=("seconds", "mean"),
    )
    ranks = stage_ranks(group)
    agreed = [_agreement(ranks.iloc[:, i], group.ap) for i in range(len(table))]
    reached = int(table["kept"].iloc[-1])
    spent = group.trials["seconds"]
    full = {
        "placements": reached,
        "without_value": reached - group.trials["placement"].nunique(),
        "kept": 0,
        "seconds": spent.sum(),
        "seconds_each": spent.mean() * group.seeds,
    }
    table = table.reset_index(drop=True).join(pd.DataFrame(agreed, columns=_AGREEMENT))
    table = pd.concat([table, pd.DataFrame([full])], ignore_index=True)
    table.insert(0, "stage", group.stages)
    return table


_AGREEMENT = ("n", "spearman", "spearman_p", "kendall", "ranked", "best_rank", "first", "regret")


def _agreement(ranks: pd.Series, ap: pd.Series) -> dict[str, object]:
    """Compare the ranks of a rung with AP after full training: columns `_AGREEMENT`."""
    ranked = ranks.dropna()
    both = ranked[ranked.index.isin(ap.index)]
    if both.empty:
        return {}
    ap_of_both = ap[both.index]
    later = ap_of_both.rank(ascending=False, method="min")
    rho, tau = rank_agreement(both, later)
    best, first = str(ap_of_both.idxmax()), str(both.idxmin())
    lost = ap_of_both[best] - ap_of_both[first]
    a, b = both.to_numpy().astype(np.float64), later.to_numpy().astype(np.float64)
    p = np.nan if np.isnan(rho) else permutation_p(a[None], b, "spearman")[0]
    row = len(both), rho, p, tau, len(ranked), ranked[best], first, lost
    return dict(zip(_AGREEMENT, row, strict=True))


def savings(group: Promoted) -> dict[str, float]:
    """Compare the seconds that promotion spent with full trainings of all placements.

    Without it every placement of the first rung would have had the surrogates of all surrogate
    rungs and a full training for every seed, at the mean seconds of those that were done; clouds
    are not counted. Keys surrogates, short and full, their sum spent; without, NaN if no full
    training finished; saved, without less spent."""
    of_surrogates = group.rungs["setting"] == ""
    seconds = group.rungs.loc[of_surrogates].groupby("rung")["seconds"]
    seconds_of_kind = {
        "surrogates": seconds.sum().sum(),
        "short": group.rungs.loc[~of_surrogates, "seconds"].sum(),
        "full": group.trials["seconds"].sum(),
    }
    spent = sum(seconds_of_kind.values())
    without = group.placements * (
        seconds.mean().sum() + group.trials["seconds"].mean() * group.seeds
    )
    return {**seconds_of_kind, "spent": spent, "without": without, "saved": without - spent}
