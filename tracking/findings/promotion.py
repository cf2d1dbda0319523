"""Placements that were promoted: by rungs of cheap stages to a full training."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from lidarplace.base.metrics import HEADLINE_METRIC
from tracking.findings.training_cost import is_longest
from tracking.kitti_iou import headline_iou
from tracking.labels import detector_label, metric_label, surrogate_name
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Rung

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
    """Whether each row is of the longest training and of none that a rung shortened.

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
        axes: further axes of the sweep.
        rungs: `promote` of `sweep.json`.
    """
    full_trials = trials[is_full(trials, axes, rungs) & (trials["detector"] != "")]
    own = [axis for axis in axes if axis in promotions.columns]
    for values, part in promotions.groupby(["detector", *own], dropna=False, sort=False):
        match = pd.Series(True, index=full_trials.index)
        place = dict(zip(("detector", *own), values, strict=True))
        for key, value in place.items():
            match &= full_trials[key] == value
        finished = full_trials[match & (full_trials["status"] == "finished")]
        part = part.sort_values(["rung", "rank"], kind="stable")
        yield Promoted(
            title=detector_label(own, place),
            stages=(*_stage_names(part, results), FULL_TRAINING),
            rungs=part,
            trials=finished,
            seeds=full_trials.loc[match, "seed"].nunique(),
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
