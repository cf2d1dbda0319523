"""What makes the numbers of a report weak, one plain sentence each."""

from __future__ import annotations

import pandas as pd

from lidarplace.metrics import HEADLINE_METRIC
from tracking.findings.groups import GENERALIST, by_setting, judges
from tracking.findings.individuals import MOST_FREQUENT, count_individuals
from tracking.findings.ray_counting import largest_linear_share, ray_counting_caution
from tracking.kitti_iou import headline_iou, judged
from tracking.labels import metric_label
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.jackknife import LEAST_ROUTES
from tracking.statistics.permutation import smallest_p

FEW_GROUND_TRUTHS = 200
FEW_INDIVIDUALS = 100
"""Of a class in the test frames. If an individual is found in all of its frames or in none, the
chance of which ones were met moves a recall of 50 % by 10 points to either side (95 %) with 100 of
them, and by 17 with 34."""
FEW_FRAMES = 20
"""Of training or test: below it a detector hardly learns, and AP hangs on a few scenes."""
FEW_POG_FRAMES = 10
"""Below it one frame changes a probability by more than a tenth."""
MANY_PLACEMENTS = 20
"""From here on the number of placements is no reason for caution."""
LEAST_P = 0.001
"""A p-value that can become smaller than this is no reason for caution."""
LEAST_AP = 5.0
"""Percent of the headline's AP; below it everywhere, differences between placements say nothing."""
STILL_FALLING = 0.05
"""Share of the loss of the epoch before that the last epoch still took off."""


def cautions(run: RunFolder, means: pd.DataFrame) -> list[str]:
    """All of them, the heaviest first.

    Args:
        means: `seed_means` of the run.
    """
    failed = _failed(run)
    if run.results.empty:
        detectors = (run.trials["detector"] != "").any()
        reason = "no detector was evaluated" if detectors else "the sweep has no detector"
        alone = f"There are no results: {reason}. Surrogates alone do not tell AP."
        weak = [*_few_pog_frames(run), *_counted_rays(run)]
        return [*failed, alone, *weak, *run.sweep.cautions]
    return [
        *failed,
        *_missing(run),
        *_few_placements(run),
        *_few_seeds(_of_judge(run, means, generalist=False)),
        *_few_generalists(_of_judge(run, means, generalist=True)),
        *_few_frames(run),
        *_few_objects(run, means),
        *_few_individuals(run),
        *_not_in_the_intervals(run),
        *_learned_little(run, means),
        *_unconverged(run),
        *_counted_rays(run),
        *run.sweep.cautions,
    ]


def _failed(run: RunFolder) -> list[str]:
    failed = run.trials[run.trials["status"] == "failed"]
    if failed.empty:
        return []
    first = str(failed["error"].iloc[0]).strip().splitlines()
    reason = f" The first error: {first[-1]}" if first else ""
    return [f"{len(failed)} of {len(run.trials)} trials did not finish.{reason}"]


def _missing(run: RunFolder) -> list[str]:
    """Placements of which nothing is known, though they were to be trained."""
    trained = run.trials[(run.trials["status"] != "pruned")]
    gone = sorted(set(trained["placement"]) - set(run.results["placement"]))
    return [f"No result for {', '.join(gone)}."] if gone else []


def _few_placements(run: RunFolder) -> list[str]:
    """By the group that has fewest, as placements are compared within groups."""
    counts = run.results.groupby(["detector", *run.axes], dropna=False)["placement"].nunique()
    said = _few(int(counts.min()))
    return [f"In the smallest group: {text}" for text in said] if counts.nunique() > 1 else said


def _few(n: int) -> list[str]:
    if n == 1:
        return ["One placement: there is nothing to compare it with."]
    if n < 3:
        return [f"{n} placements: a correlation needs at least 3."]
    if n >= MANY_PLACEMENTS:
        return []
    if smallest_p(n) > LEAST_P:
        return [f"Only {n} placements: no two-sided p-value can be below {smallest_p(n):.2g}."]
    return [f"Only {n} placements: weak correlations go unseen."]


def _of_judge(run: RunFolder, means: pd.DataFrame, generalist: bool) -> pd.DataFrame:
    """Rows of placements that one detector judged, or of those with detectors of their own."""
    return means[(judges(means, run.sweep.judge) == GENERALIST) == generalist]


def _few_generalists(means: pd.DataFrame) -> list[str]:
    """A generalist's own chance is the same for all placements, but not without effect."""
    if not (means["seeds"] == 1).any():
        return []
    return ["One generalist: another one may rank the placements otherwise; no interval has that."]


def _few_seeds(means: pd.DataFrame) -> list[str]:
    known = means[means["seeds"] > 0]
    seeds = known["seeds"]
    if seeds.empty or seeds.min() >= 3:
        return []
    if seeds.max() < 2:
        return ["One seed: differences between placements may be chance of the training."]
    alone = list(dict.fromkeys(known.loc[seeds < 2, "placement"].astype(str)))
    said = [f"One seed only for {', '.join(alone)}."] if alone else []
    if seeds.max() < 3:
        said.append("Two seeds: the spread over seeds is itself uncertain.")
    return said


def _few_frames(run: RunFolder) -> list[str]:
    train, test = run.sweep.frames.train, run.sweep.frames.test
    said = []
    if train < FEW_FRAMES:
        said.append(
            f"Only {train} training frame{'s' * (train != 1)}: a detector learns little from so "
            "few, and the surrogates are of the same frames."
        )
    if test < FEW_FRAMES:
        said.append(
            f"Only {test} test frame{'s' * (test != 1)}: other frames may give another AP and "
            "another order."
        )
    return said


def _few_pog_frames(run: RunFolder) -> list[str]:
    """Of surrogates alone; without any there is nothing to be careful about."""
    frames = run.sweep.frames.train
    if run.surrogates.empty or frames >= FEW_POG_FRAMES:
        return []
    return [
        f"The surrogates are of only {frames} frame{'s' * (frames != 1)}: other frames may rank "
        "the placements otherwise."
    ]


def _counted_rays(run: RunFolder) -> list[str]:
    said = ray_counting_caution(largest_linear_share(run.surrogates))
    return [said] if said else []


def _few_objects(run: RunFolder, means: pd.DataFrame) -> list[str]:
    said = []
    counts = means[means["class"].isin(run.classes)].groupby("class")["ground_truths"].min()
    for name, count in counts.items():
        if count == 0:
            said.append(f"{name}: no ground truth in the test frames, so no AP.")
        elif count < FEW_GROUND_TRUTHS:
            said.append(f"{name}: only {count} ground truths in the test frames.")
    return said


def _few_individuals(run: RunFolder) -> list[str]:
    said = []
    for name, row in _fewest(run, "individuals").iterrows():
        met = row["individuals"]
        if met < FEW_INDIVIDUALS:
            ten = f", {MOST_FREQUENT} of which have {100 * row['share_of_ten']:.0f} % of the boxes"
            said.append(
                f"{name}: {row['boxes']:,} test boxes are {met} individual{'s' * (met != 1)}"
                f"{ten if met > MOST_FREQUENT else ''}: others may give another AP."
            )
    return said


def _fewest(run: RunFolder, column: str) -> pd.DataFrame:
    """Counts of the setting that has fewest test objects, as each is judged by its own; by class.

    Empty where the objects are not known.
    """
    if run.individuals is None or run.individuals.empty:
        return pd.DataFrame()
    test = run.individuals[run.individuals["split"] == "test"]
    counts = pd.concat([count_individuals(own) for _, own in by_setting(test, run.axes)])
    fewest = counts.sort_values(column, kind="stable").drop_duplicates("class").set_index("class")
    return fewest.reindex([name for name in run.classes if name in fewest.index])


def _not_in_the_intervals(run: RunFolder) -> list[str]:
    if run.left_out is None:
        return [
            "Intervals are over seeds alone, as if these were the only test objects: the run "
            "folder has no left_out.parquet, which earlier versions did not write. The sweep's "
            "command makes it."
        ]
    routes = _fewest(run, "routes")
    few = [str(name) for name, row in routes.iterrows() if row["routes"] < LEAST_ROUTES]
    if not few:
        return []
    return [
        f"Fewer than {LEAST_ROUTES} test routes with {', '.join(few)}: intervals allow for which "
        "individuals were met, not for what routes differ in."
    ]


def _learned_little(run: RunFolder, means: pd.DataFrame) -> list[str]:
    said = []
    for name in run.classes:
        iou = headline_iou(run.results, name)
        ap = judged(means, run.results, name)["mean"]
        if ap.notna().any() and ap.max() < LEAST_AP:
            said.append(
                f"{name}: {metric_label(HEADLINE_METRIC, iou)} is below {LEAST_AP:g} % everywhere: "
                "the detector learned too little."
            )
    return said


def _unconverged(run: RunFolder) -> list[str]:
    """Training that was still learning when it ended: a longer one may rank otherwise."""
    if run.curves is None or run.curves.empty:
        return []
    loss = run.curves[run.curves["metric"] == "loss"].sort_values("epoch")
    ends = [own["value"].tolist()[-2:] for _, own in loss.groupby("trial", sort=False)]
    fell = [1 - end[1] / end[0] for end in ends if len(end) == 2 and end[0] > 0]
    still = sum(share > STILL_FALLING for share in fell)
    if not still:
        return []
    return [
        f"Training was short: in {still} of {len(fell)} trials the last epoch still took more than "
        f"{100 * STILL_FALLING:g} % off the loss. A longer training may rank otherwise."
    ]
