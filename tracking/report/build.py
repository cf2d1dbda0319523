"""Build the pages of a run folder: the report, beside it Markdown and tables, and the decision."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from lidarplace.base.registry import Registry
from tracking.findings.best_placement import BestPlacement
from tracking.findings.best_surrogate import Predictors, best_surrogates
from tracking.findings.ceiling import beside, ceilings
from tracking.findings.correlation import correlate
from tracking.findings.distinct_rigs import copies, without
from tracking.findings.failures import Failures
from tracking.findings.generalist import with_judgements
from tracking.findings.groups import Group, groups, pictured
from tracking.findings.individuals import count_individuals
from tracking.findings.leave_one_out import leave_one_out
from tracking.findings.promotion import fully_trained
from tracking.findings.summary import by_surrogate, seed_means
from tracking.kitti_iou import judged
from tracking.labels import some
from tracking.pages.csv_files import FOLDER, write_csv_files
from tracking.pages.markdown import escaped, verbatim, write_markdown
from tracking.pages.page import write_page
from tracking.pages.section import Section
from tracking.report.cautions import cautions
from tracking.report.decision.build import write_decision
from tracking.report.decision.recommendation import answer, recommendations
from tracking.report.failures import FILE as FAILURES
from tracking.report.failures import compared_failures, write_failures
from tracking.report.headline import Verdict, headline_ranking, surrogate_verdicts, verdicts
from tracking.report.sections.accuracy import accuracy_section
from tracking.report.sections.agreement import agreement_section
from tracking.report.sections.best import best_section
from tracking.report.sections.binned import by_distance_section, by_sector_section
from tracking.report.sections.ceiling import ceiling_section
from tracking.report.sections.clouds import clouds_section
from tracking.report.sections.correlation import correlation_section
from tracking.report.sections.coverage import coverage_section, rigs_section
from tracking.report.sections.curves import curves_section
from tracking.report.sections.density import density_section
from tracking.report.sections.detectors import detectors_section
from tracking.report.sections.failures import failures_section, lacking_section
from tracking.report.sections.generalist import generalist_section
from tracking.report.sections.individuals import individuals_section
from tracking.report.sections.placements import placements_section
from tracking.report.sections.predictors import counted, predictors_section
from tracking.report.sections.promotion import promotion_section
from tracking.report.sections.published import published_section
from tracking.report.sections.recorded_clouds import recorded_clouds_section
from tracking.report.sections.regret import regret_section
from tracking.report.sections.reliability import reliability_section
from tracking.report.sections.requirements import requirements_section
from tracking.report.sections.sampling_error import sampling_error_section
from tracking.report.sections.tilts import tilts_section
from tracking.report.sections.training_cost import training_cost_section
from tracking.report.sections.where_time_went import reduced_batches, where_time_went
from tracking.run_folders.sweep import RunFolder

_log = logging.getLogger(__name__)

MOST_CARDS = 6
"""Verdicts that are cards; more are rows of a table, or the first screen would be many."""


def build_report(run: Path) -> Path:
    """Write the pages of the run folder `run` into it; return the report.

    `report.html` and, with results, `decision.html` and `failures.html` are one file each that
    loads nothing from a network, see `tracking.pages.page`. `report.md` and `tables/` hold the
    tables of the report, rounded and raw.

    Raises:
        ValueError: `run` is no run folder, see `RunFolder.read`.
    """
    complete = RunFolder.read(run)
    same = copies(complete)
    whole = without(complete, set(same))
    found = Analysis.of(whole)
    folder = found.run
    pair, failures = found.pair, found.failures
    sections = list(_sections(found))
    for section in sections:
        section.tables = [table.without_dashes() for table in section.tables]
    cards, findings = _verdicts(found)
    recommended = recommendations(found.rankings)
    said = answer(folder, recommended) if recommended else None
    extent = _extent(folder)
    warnings = [*cautions(folder), *_same_rigs(same), *reduced_batches(folder.tasks)]
    facts = folder.sweep.model_dump(
        mode="json", by_alias=True, exclude_unset=True, exclude={"placements"}
    )
    write_csv_files(folder.path / FOLDER, sections)
    _write_failures(folder, pair, failures, extent)
    decision = write_decision(
        folder, found.rankings, found.means, extent, warnings, None if pair is None else failures
    )
    page = write_page(
        folder.path / "report.html",
        Path(__file__).with_name("report.html"),
        sections,
        name=folder.sweep.name,
        run=folder,
        decision=decision.name if decision else None,
        verdicts=cards,
        answer=said,
        most_cards=MOST_CARDS,
        findings=findings,
        extent=extent,
        warnings=warnings,
        sweep=json.dumps(facts, indent=2, default=str),
    )
    first = [escaped(extent), *map(_in_markdown, cards)]
    if said is not None and len(said.leads) > 1:
        first.append(f"**{escaped(said.sure)}**")
    if said is not None and said.command:
        first += ["For more evidence, run:", verbatim(said.command)]
    first += [f"Reasons for doubt: {len(warnings)}"] if warnings else []
    first += [f"> Warning: {escaped(warning)}" for warning in warnings]
    last = {"Command": folder.sweep.command, "Configuration": folder.config}
    name = folder.sweep.name
    write_markdown(folder.path / "report.md", name, first, sections, last, page.name)
    return page


@dataclass(frozen=True)
class Analysis:
    """What sections are about.

    Attributes:
        whole: all placements, trained fully or not.
        run: the placements after the longest training; shorter ones show what they cost.
        surrogates: those of the run, and what its generalist says (`with_judgements`).
        means: `seed_means`.
        ceilings: `ceilings`.
        correlations, errors, predicted: `correlate` beside `ceilings`, `leave_one_out` and
            `best_surrogates`.
        groups: what is compared with each other.
        rankings: every group with its `headline_ranking`.
        order: `best_first`.
        pair, failures: `compared_failures`, and the section of it.
    """

    whole: RunFolder
    run: RunFolder
    surrogates: pd.DataFrame
    means: pd.DataFrame
    ceilings: pd.DataFrame
    correlations: pd.DataFrame
    errors: pd.DataFrame
    predicted: list[Predictors]
    groups: list[Group]
    rankings: list[tuple[Group, dict[str, BestPlacement]]]
    order: list[str]
    pair: Failures | None
    failures: Section | None

    @classmethod
    def of(cls, whole: RunFolder) -> Analysis:
        run = fully_trained(whole)
        results, surrogates = run.results, with_judgements(run)
        means = seed_means(results, run.axes, run.left_out, run.sweep.judge)
        most = ceilings(results, run.left_out, run.axes)
        correlations = beside(correlate(results, surrogates, run.axes), most, run.axes)
        errors = leave_one_out(results, surrogates, run.axes)
        found = list(groups(run))
        rankings = [(group, headline_ranking(run, group)) for group in found]
        pair = compared_failures(run, rankings)
        return cls(
            whole=whole,
            run=run,
            surrogates=surrogates,
            means=means,
            ceilings=most,
            correlations=correlations,
            errors=errors,
            predicted=best_surrogates(results, surrogates, correlations, errors, run.axes),
            groups=found,
            rankings=rankings,
            order=best_first(run, means),
            pair=pair,
            failures=lacking_section(run) if pair is None else failures_section(pair, FAILURES),
        )


def _promotion(found: Analysis) -> Section | None:
    promotions = found.run.promotions
    if promotions is None or promotions.empty:
        return None
    return promotion_section(found.whole, promotions)


SECTIONS: Registry[Callable[[Analysis], Section | None]] = Registry(
    "lidarplace.sections",
    {
        "best": lambda found: best_section(found.run, found.rankings, found.means),
        "placements": lambda found: placements_section(found.run, found.groups, found.means),
        "requirements": lambda found: requirements_section(found.run, found.order),
        "agreement": lambda found: agreement_section(found.run, found.groups),
        "promotion": _promotion,
        "predictors": lambda found: predictors_section(
            found.run, found.correlations, found.errors, found.predicted
        ),
        "ceiling": lambda found: ceiling_section(found.run, found.ceilings),
        "reliability": lambda found: reliability_section(found.run),
        "regret": lambda found: regret_section(found.run, found.rankings, found.surrogates),
        "generalist": lambda found: generalist_section(
            found.run, found.rankings, found.means, found.correlations, found.surrogates
        ),
        "recorded_clouds": lambda found: recorded_clouds_section(found.run),
        "correlation": lambda found: correlation_section(
            found.run, found.groups, found.means, found.correlations, found.errors, found.surrogates
        ),
        "published": lambda found: published_section(found.run, found.means),
        "detectors": lambda found: detectors_section(found.run, found.groups, found.means),
        "tilts": lambda found: tilts_section(found.run, found.groups, found.means),
        "density": lambda found: density_section(found.run, found.groups, found.means),
        "rigs": lambda found: rigs_section(found.run, found.order),
        "coverage": lambda found: coverage_section(found.run, found.order),
        "clouds": lambda found: clouds_section(found.run, found.order),
        "individuals": lambda found: individuals_section(found.run),
        "by_distance": lambda found: by_distance_section(found.run, found.groups),
        "by_sector": lambda found: by_sector_section(found.run, found.groups),
        "failures": lambda found: found.failures,
        "accuracy": lambda found: accuracy_section(found.run),
        "sampling_error": lambda found: sampling_error_section(found.run, found.order),
        "training_cost": lambda found: training_cost_section(found.whole),
        "curves": lambda found: curves_section(found.run, found.groups),
        "where_time_went": lambda found: where_time_went(found.run),
    },
)
"""The page from top to bottom; what other packages add comes after ours."""


def _sections(found: Analysis) -> Iterator[Section]:
    for name, make in SECTIONS.installed().items():
        try:
            section = make(found)
        except Exception as error:  # a plug-in can raise anything
            if name in SECTIONS.own:
                raise
            _log.warning("plug-in left out: section %s: %s: %s", name, type(error).__name__, error)
            continue
        if section is not None:
            yield section


def _write_failures(
    run: RunFolder, pair: Failures | None, section: Section | None, extent: str
) -> None:
    """The page of the rigs that are compared, or none of an earlier run."""
    target = run.path / FAILURES
    if pair is None or section is None:
        target.unlink(missing_ok=True)
        return
    links = {"decision.html": "Decision", "report.html": "Research report"}
    frames = run.failures
    if frames is not None and not frames.are_of(pair.rigs, pair.objects["object"]):
        frames = None
    write_failures(target, pair, frames, section, run.roi, run.sweep.body, extent, links)


def _verdicts(found: Analysis) -> tuple[list[Verdict], str]:
    """The verdicts, and what is said of surrogates where their table has no room for it."""
    run, predicted = found.run, found.predicted
    cards = [v for group, best in found.rankings for v in verdicts(run, group, best, predicted)]
    cards = cards or [v for group in found.groups for v in surrogate_verdicts(run, group)]
    many = len(cards) > MOST_CARDS and len(predicted) > 0
    return cards, counted(run, predicted, found.correlations) if many else ""


def _in_markdown(card: Verdict) -> str:
    said = " ".join([f"{card.metric}: {card.lead}.", card.sure, *card.surrogates])
    return f"**{escaped(card.heading)}: {escaped(card.best)}.** {escaped(said)}"


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
