"""Build `report.html` from a run folder."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pandas as pd

from tracking.accuracy import relative_errors, summarise
from tracking.correlation import correlate, with_sums
from tracking.figures.accuracy import accuracy_figure
from tracking.figures.from_above import add_vehicle, coverage_from_above, metres, pog_from_above
from tracking.figures.heat_map import heat_map
from tracking.figures.intervals import intervals
from tracking.figures.learning_curves import learning_curves
from tracking.figures.point_cloud import point_clouds
from tracking.figures.scatter import scatter
from tracking.figures.style import text
from tracking.figures.surrogate_agreement import surrogate_agreement
from tracking.figures.training_cost import training_cost_figure
from tracking.labels import surrogate_name
from tracking.promotion import is_full
from tracking.report.groups import Group, by_setting, groups
from tracking.report.headline import (
    HEADLINE_METRIC,
    HEADLINE_SURROGATES,
    separation_sentences,
    surrogate_verdicts,
    verdicts,
    warnings,
)
from tracking.report.page import write_page
from tracking.report.promotion import promotion_section
from tracking.report.section import Section
from tracking.report.tables import (
    MOST_ROWS,
    accuracy_table,
    correlation_table,
    fitted_q_table,
    placement_table,
    sampling_error_table,
    training_cost_table,
    trial_table,
)
from tracking.report.where_time_went import reduced_batches, where_time_went
from tracking.run_folder import RunFolder
from tracking.sampling_error import paired_differences
from tracking.summary import (
    by_surrogate,
    deciding_surrogate,
    headline_iou,
    seed_means,
    surrogates_of,
)
from tracking.training_cost import (
    COST_AXES,
    summarise_cost,
    training_cost,
    varied_cost_axes,
)

MOST_MAPS = 12
"""Placements drawn in maps and clouds: a page must stay small."""
MOST_INTERVALS = 20
"""Placements whose sampling errors are shown: every pair of them is compared."""


def build_report(run: Path) -> Path:
    """Write `report.html` into the run folder `run` and return its path.

    One file that loads nothing from a network, see `tracking.report.page`.

    Raises:
        ValueError: `run` is no run folder, see `RunFolder.read`.
    """
    whole = RunFolder.read(run)
    # Placements are compared after the longest training; shorter ones show what they cost.
    full = is_full(whole.results, whole.axes, whole.sweep.get("promote", ()))
    folder = replace(whole, results=whole.results[full])
    means = seed_means(folder.results, folder.axes)
    correlations = correlate(folder.results, folder.surrogates, folder.axes)
    found = list(groups(folder))
    ranked = _best_first(folder, means)
    # A sweep of surrogates alone trains no detector.
    detectors = bool((folder.trials["detector"] != "").any())
    promotions = folder.promotions
    sections = [
        _placements(folder, found, means),
        *([] if detectors else [_surrogates_agree(folder, found)]),
        *([] if promotions is None or promotions.empty else [promotion_section(whole, promotions)]),
        *([_correlation(folder, found, means, correlations)] if detectors else []),
        _from_above(folder, ranked),
        *([_clouds(folder, ranked)] if detectors else []),
        _accuracy(folder),
        _sampling_error(folder, ranked),
        *([_training_cost(whole)] if varied_cost_axes(whole.results) else []),
        *([_curves(folder, found)] if detectors else []),
        where_time_went(folder),
    ]
    cards = [v for group in found for v in verdicts(folder, group, means, correlations)]
    return write_page(
        folder.path / "report.html",
        Path(__file__).with_name("report.html"),
        name=folder.sweep["name"],
        run=folder,
        verdicts=cards or [v for group in found for v in surrogate_verdicts(folder, group)],
        several=len(found) > 1,
        warnings=[*warnings(folder, means), *reduced_batches(folder.tasks)],
        pruned=int((folder.trials["status"] == "pruned").sum()),
        sections=sections,
        sweep=json.dumps(
            {k: v for k, v in folder.sweep.items() if k != "placements"}, indent=2, default=str
        ),
    )


def _best_first(run: RunFolder, means: pd.DataFrame) -> list[str]:
    """Placements by headline AP of the first class, over all groups; then by a surrogate."""
    first = run.classes[0]
    own = means[
        (means["class"] == first)
        & (means["metric"] == HEADLINE_METRIC)
        & (means["iou"] == headline_iou(run.results, first))
    ]
    order = own.groupby("placement")["mean"].mean().sort_values(ascending=False).index.tolist()
    return list(dict.fromkeys((*order, *by_surrogate(run.surrogates), *run.placements)))


def _placements(run: RunFolder, found: list[Group], means: pd.DataFrame) -> Section:
    with_results = (
        "Mean ± standard deviation over seeds, best AP first; the highest of a column is bold."
    )
    alone = (
        f"No detector was evaluated. Order: {surrogate_name(deciding_surrogate(run.surrogates))}. "
        "Ranks in brackets, 1 the highest value. The ranks of S-MIG, IG and residual entropy run "
        "against those of covered entropy: which way round is better is for a detector to tell."
    )
    section = Section("Placements", [alone if run.results.empty else with_results])
    for group in found:
        for name in (*run.classes, "all"):
            table = placement_table(run, group, means, name)
            if table is not None:
                files = "surrogates.parquet" if run.results.empty else "results.parquet"
                section.tables.append(table.first(MOST_ROWS, files))
    failed = run.trials[run.trials["status"] == "failed"]
    if len(failed):
        section.tables.append(trial_table(failed, run.axes).first(MOST_ROWS, "trials.parquet"))
    return section


def _surrogates_agree(run: RunFolder, found: list[Group]) -> Section:
    section = Section(
        "Do the surrogates agree?", ["Spearman's ρ between surrogates, over all placements."]
    )
    sums = with_sums(run.surrogates, run.axes)
    names = (*run.classes, "all") if len(run.classes) > 1 else run.classes
    for group in found:
        for name in names:
            title = "Sum of the classes" if name == "all" else text(name)
            title += f" · {text(group.title)}" if group.varies else ""
            plot = surrogate_agreement(surrogates_of(sums, group.setting, name), title)
            if plot is not None:
                section.figures.append(plot)
    if not section.figures:
        section.notes = ["Fewer than 3 placements: no rank agreement."]
    return section


def _correlation(
    run: RunFolder, found: list[Group], means: pd.DataFrame, correlations: pd.DataFrame
) -> Section:
    tested = int(correlations["pairs_tested"].iloc[0]) if len(correlations) else 0
    section = Section(
        "Did the surrogates predict AP and recall?",
        [
            "A point is a placement, its bar one standard deviation over seeds. ρ is Spearman's, "
            "with its 95 % bootstrap interval over placements and seeds and its permutation "
            "p-value, both sides. No sign is assumed.",
            f"{tested} pairs of a surrogate and a metric were tested: about {0.05 * tested:.0f} "
            "would have p < 0.05 by chance alone if none were related. Within a class, IG and "
            "residual entropy order placements as S-MIG does, and covered entropy the other way "
            "round: they are one test, not four.",
        ],
    )
    if run.promotions is not None and len(run.promotions):
        section.notes.append(
            "Only placements that were promoted were trained in full. A surrogate that chose them "
            "varies less among them than among all: its coefficient here is not that over all."
        )
    surrogates = with_sums(run.surrogates, run.axes)
    order = list(run.placements)
    for group in found:
        for name in (*run.classes, "all"):
            metric = "recall" if name == "all" else HEADLINE_METRIC
            iou = headline_iou(run.results, name)
            own, tests = (
                part[(part["class"] == name) & (part["metric"] == metric) & (part["iou"] == iou)]
                for part in (group.of(means), group.of(correlations))
            )
            title = "All classes" if name == "all" else text(name)
            title += f" · {text(group.title)}" if group.varies else ""
            if not (tests["n"] > 0).any():
                continue
            predictors = surrogates_of(surrogates, group.setting, name)
            section.figures.append(scatter(own, predictors, tests, title, order))
    for group in found:
        for name in (*run.classes, "all"):
            part = group.of(correlations)
            title = "All classes" if name == "all" else text(name)
            title += f" · {text(group.title)}" if group.varies else ""
            plot = heat_map(part[part["class"] == name], f"Spearman's ρ · {title}")
            if plot is not None:
                section.figures.append(plot)
    if run.expected_ig_by_q is not None:
        fitted = fitted_q_table(run, run.expected_ig_by_q, found, means)
        section.tables += [fitted] if fitted else []
    if len(correlations):
        section.tables.append(correlation_table(correlations, run.axes))
    return section


def _from_above(run: RunFolder, ranked: list[str]) -> Section:
    section = Section("Coverage and POG from above")
    if run.maps is None:
        section.notes.append("The run folder has no maps.npz.")
        return section
    section.notes.append(
        "POG: entropy of each column of voxels, where objects may or may not be. Coverage: share "
        "of each column that some beam meets; LiDARs and a nominal vehicle in orange."
    )
    for name, entropy in run.maps.pog.items():
        plot = pog_from_above(entropy, run.roi, f"POG · {text(name)}")
        section.figures.append(plot)
    shown = [name for name in ranked if name in run.maps.coverage][:MOST_MAPS]
    for name in shown:
        plot = coverage_from_above(
            run.maps.coverage[name], run.roi, f"Coverage · {text(name)}", run.placements[name]
        )
        section.figures.append(plot)
    for plot in section.figures:
        add_vehicle(plot)
        metres(plot, run.roi)
    if len(shown) < len(run.placements):
        section.notes.append(f"{len(shown)} of {len(run.placements):,} placements are drawn.")
    return section


def _clouds(run: RunFolder, ranked: list[str]) -> Section:
    section = Section("One frame, as each placement sees it", columns=2)
    shown = [name for name in ranked if run.frame is not None and name in run.frame.points]
    shown = shown[:MOST_MAPS]
    if run.frame is None or not shown:
        section.notes.append("The run folder has no frame.npz.")
        return section
    section.notes.append(
        "The same objects under two placements, chosen by the menus: at the start the best and the "
        "last of the ranking. A colour is a LiDAR, outlines are the ground truth; at most "
        "8,000 points are drawn."
    )
    for first in dict.fromkeys((shown[0], shown[-1])):
        section.figures.append(point_clouds(run.frame, run.roi, shown, first))
    return section


def _accuracy(run: RunFolder) -> Section:
    section = Section("Surrogates: error against run time", columns=1)
    if run.accuracy is None or run.accuracy.empty:
        section.notes.append("The run folder has no accuracy.parquet.")
        return section
    section.notes.append(
        "Left: error of the method, of fewer azimuth steps and of fewer frames at one resolution. "
        "Middle: error against the finest resolution that was computed; a coarse grid makes beams "
        "thick and too few rays leave gaps, and the two errors can cancel. Right: whether the "
        "placements are ranked alike, which is what a choice needs. Medians over placements, bars "
        "to the largest; hollow points have no error. The menu chooses the surrogate."
    )
    for title, part in by_setting(run.accuracy, run.axes):
        summary = summarise(relative_errors(part))
        for name, own in summary.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.figures.append(accuracy_figure(own, f"Error against run time · {label}"))
            section.tables.append(accuracy_table(own, label))
    return section


def _sampling_error(run: RunFolder, ranked: list[str]) -> Section:
    section = Section("Surrogates: sampling error of the POG", columns=2)
    tables = {"sampling_error": run.sampling_error, "pog_resamples": run.pog_resamples}
    missing = [name for name, table in tables.items() if table is None or table.empty]
    if run.sampling_error is None or run.pog_resamples is None or missing:
        names = " and ".join(f"{name}.parquet" for name in missing)
        section.notes.append(f"The run folder has no {names}.")
        return section
    section.notes.append(
        "The POG is counted over some frames and not over all traffic. Blocks of consecutive "
        "frames of a route were drawn again with replacement, the same for every placement. "
        "Intervals are 1.96 standard deviations to each side, nominally 95 % and somewhat less "
        "with few blocks. Entropies from few frames are too low; the estimated bias is taken off "
        "the interval, not off the value."
    )
    known = set(run.sampling_error["placement"])
    shown = [name for name in ranked if name in known][:MOST_INTERVALS]
    if len(shown) < len(known):
        section.notes.append(
            f"The best {len(shown)} of {len(known):,} placements; sampling_error.parquet has all."
        )
    best, draws = (
        table[table["placement"].isin(shown)] for table in (run.sampling_error, run.pog_resamples)
    )
    resamples = dict(by_setting(draws, run.axes))
    for title, part in by_setting(best, run.axes):
        pairs = paired_differences(
            part[part["surrogate"].isin(HEADLINE_SURROGATES)], resamples[title]
        )
        for name, own in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.notes += separation_sentences(pairs[pairs["class"] == name], label)
            section.figures.append(
                intervals(own, label, [name for name in run.placements if name in shown])
            )
            section.tables.append(sampling_error_table(own, label))
    return section


def _training_cost(run: RunFolder) -> Section:
    section = Section("Training: error against run time", columns=1)
    if run.curves is None or run.curves.empty:
        section.notes.append("The run folder has no curves.parquet.")
        return section
    section.notes.append(
        "AP after fewer epochs and with a share of the training frames, against the seconds of all "
        "epochs. The reference is the longest training of the same placement, detector and seed, "
        "and the error is its AP less that of a trial. Kendall's τ says whether a shorter training "
        "ranks the placements as the longest one does. Everything else on this page is about the "
        "longest training."
    )
    cost = training_cost(run.results, run.curves, run.axes)
    varied = varied_cost_axes(run.results)
    further = [axis for axis in run.axes if axis not in COST_AXES]
    for title, part in by_setting(cost, further):
        # Means are over the same placements; promotion trains more of them short than long.
        summary = summarise_cost(part[part["reference_ap"].notna()], varied)
        for name, own in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.figures.append(training_cost_figure(own, text(label), list(run.placements)))
            section.tables.append(
                training_cost_table(summary[summary["class"] == name], varied, label)
            )
    return section


def _curves(run: RunFolder, found: list[Group]) -> Section:
    section = Section("Learning curves")
    if run.curves is None or run.curves.empty:
        section.notes.append("The run folder has no curves.parquet.")
        return section
    section.notes.append("One line a trial; lines of one colour differ by seed.")
    for group in found:
        for metric in dict.fromkeys(run.curves["metric"]):
            plot = learning_curves(
                run.curves, group.of(run.trials), metric, text(group.title), list(run.placements)
            )
            section.figures.append(plot)
    section.columns = min(2, len(section.figures))
    return section
