"""Build the report of a run folder: `report.html`, `report.md` and `tables/`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pandas as pd

from tracking.findings.best_surrogate import which_predicts
from tracking.findings.correlation import correlate
from tracking.findings.distinct_rigs import copies, without
from tracking.findings.groups import groups, pictured
from tracking.findings.individuals import count_individuals
from tracking.findings.leave_one_out import leave_one_out
from tracking.findings.promotion import is_full
from tracking.findings.summary import by_surrogate, seed_means
from tracking.kitti_iou import judged
from tracking.labels import some
from tracking.pages.csv_files import FOLDER, write_csv_files
from tracking.pages.markdown import escaped, write_markdown
from tracking.pages.page import write_page
from tracking.report.cautions import cautions
from tracking.report.headline import headline_ranking, surrogate_verdicts, verdicts
from tracking.report.sections.accuracy import accuracy_section
from tracking.report.sections.agreement import agreement_section
from tracking.report.sections.best import best_section
from tracking.report.sections.by_distance import by_distance_section
from tracking.report.sections.clouds import clouds_section
from tracking.report.sections.correlation import correlation_section
from tracking.report.sections.coverage import coverage_section, rigs_section
from tracking.report.sections.curves import curves_section
from tracking.report.sections.density import density_section
from tracking.report.sections.detectors import detectors_section
from tracking.report.sections.individuals import individuals_section
from tracking.report.sections.placements import placements_section
from tracking.report.sections.predictors import counted, predictors_section
from tracking.report.sections.promotion import promotion_section
from tracking.report.sections.published import published_section
from tracking.report.sections.sampling_error import sampling_error_section
from tracking.report.sections.tilts import tilts_section
from tracking.report.sections.training_cost import training_cost_section
from tracking.report.sections.where_time_went import reduced_batches, where_time_went
from tracking.run_folders.sweep import RunFolder

MOST_CARDS = 6
"""Verdicts that are cards; more are rows of a table, or the first screen would be many."""


def build_report(run: Path) -> Path:
    """Write `report.html`, `report.md` and `tables/` into the run folder `run`; return the page.

    The page is one file that loads nothing from a network, see `tracking.pages.page`. The other
    two hold the same tables, rounded and raw.

    Raises:
        ValueError: `run` is no run folder, see `RunFolder.read`.
    """
    complete = RunFolder.read(run)
    same = copies(complete)
    whole = without(complete, set(same))
    # Placements are compared after the longest training; shorter ones show what they cost.
    full = is_full(whole.results, whole.axes, whole.sweep.promote)
    folder = replace(whole, results=whole.results[full])
    means = seed_means(folder.results, folder.axes, folder.left_out)
    sample = (folder.results, folder.surrogates)
    correlations = correlate(*sample, folder.axes)
    errors = leave_one_out(*sample, folder.axes)
    predicted = which_predicts(*sample, correlations, errors, folder.axes)
    found = list(groups(folder))
    rankings = [(group, headline_ranking(folder, group)) for group in found]
    order = best_first(folder, means)
    promotions = folder.promotions
    promotions = None if promotions is None or promotions.empty else promotions
    sections = [
        section
        for section in (
            best_section(folder, rankings, means),
            placements_section(folder, found, means),
            agreement_section(folder, found),
            None if promotions is None else promotion_section(whole, promotions),
            predictors_section(folder, correlations, errors, predicted),
            correlation_section(folder, found, means, correlations, errors),
            published_section(folder, means),
            detectors_section(folder, found, means),
            tilts_section(folder, found, means),
            density_section(folder, found, means),
            rigs_section(folder, order),
            coverage_section(folder, order),
            clouds_section(folder, order),
            individuals_section(folder),
            by_distance_section(folder, found),
            accuracy_section(folder),
            sampling_error_section(folder, order),
            training_cost_section(whole),
            curves_section(folder, found),
            where_time_went(folder),
        )
        if section is not None
    ]
    cards = [v for group, ranked in rankings for v in verdicts(folder, group, ranked, predicted)]
    cards = cards or [v for group in found for v in surrogate_verdicts(folder, group)]
    # A table of verdicts has no room for the findings about surrogates.
    many = len(cards) > MOST_CARDS and len(predicted) > 0
    findings = counted(folder, predicted, correlations) if many else ""
    weaknesses = [*cautions(folder, means), *_same_rigs(same), *reduced_batches(folder.tasks)]
    extent = _extent(folder)
    facts = folder.sweep.model_dump(mode="json", exclude_unset=True, exclude={"placements"})
    write_csv_files(folder.path / FOLDER, sections)
    page = write_page(
        folder.path / "report.html",
        Path(__file__).with_name("report.html"),
        sections,
        name=folder.sweep.name,
        run=folder,
        verdicts=cards,
        most_cards=MOST_CARDS,
        findings=findings,
        extent=extent,
        warnings=weaknesses,
        sweep=json.dumps(facts, indent=2, default=str),
    )
    write_markdown(
        folder.path / "report.md",
        folder.sweep.name,
        [
            escaped(extent),
            *(
                f"**{escaped(card.heading)}: {escaped(card.best)}.** "
                + escaped(" ".join([f"{card.metric}: {card.lead}.", card.sure, *card.surrogates]))
                for card in cards
            ),
            *(f"> Warning: {escaped(warning)}" for warning in weaknesses),
        ],
        sections,
        {"Command": folder.sweep.command, "Configuration": folder.config},
        page.name,
    )
    return page


def best_first(run: RunFolder, means: pd.DataFrame) -> list[str]:
    """Placements by headline AP of the first class, over all groups; then by a surrogate."""
    first = run.classes[0]
    own = judged(means, run.results, first)
    order = own.groupby("placement")["mean"].mean().sort_values(ascending=False).index.tolist()
    return list(dict.fromkeys((*order, *by_surrogate(run.surrogates), *run.placements)))


def _extent(run: RunFolder) -> str:
    """How much was compared, in one line."""
    pruned = int((run.trials["status"] == "pruned").sum())
    shown = pictured(run)
    frames = run.sweep.frames
    parts = [
        f"{len(run.placements)} placements, {len(run.trials)} trials",
        *([f"{pruned} of them pruned by promotion"] if pruned else []),
        f"{frames.train} training and {frames.test} test frames{_met(run)}",
        *([shown] if shown else []),
    ]
    return f"{', '.join(parts)}."


def _met(run: RunFolder) -> str:
    """The objects of the test frames; "" where they are unknown or differ with the setting."""
    if run.individuals is None or set(run.axes) & set(run.individuals.columns):
        return ""
    counts = count_individuals(run.individuals[run.individuals["split"] == "test"])
    boxes, individuals = counts["boxes"].sum(), counts["individuals"].sum()
    return f" with {boxes:,} boxes of {individuals:,} individuals" if boxes else ""


def _same_rigs(copies: dict[str, str]) -> list[str]:
    if not copies:
        return []
    named = some([f"{name} is {first}" for name, first in copies.items()])
    return [f"The same rig under two names is counted once: {named}."]
