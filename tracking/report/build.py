"""Pages of a run folder: the report, its Markdown and tables, the decision and the failures."""

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.base.registry import Registry
from tracking.findings.groups import pictured
from tracking.findings.individuals import count_individuals
from tracking.labels import some
from tracking.pages import html_page as pages
from tracking.pages.section import Section
from tracking.report.analysis import Analysis as Analysis
from tracking.report.cautions import cautions
from tracking.report.decision.build import write_decision
from tracking.report.failures import write_failures
from tracking.report.headline import Statement, surrogate_statements
from tracking.report.paper_figures import write_pictures
from tracking.report.recommendation import Answer
from tracking.report.sections.ablations import density_section, tilts_section
from tracking.report.sections.accuracy import accuracy_section
from tracking.report.sections.best import best_section, by_class_section
from tracking.report.sections.ceiling import reliability_section
from tracking.report.sections.clouds import clouds_section
from tracking.report.sections.coefficient_map import coefficient_map_section
from tracking.report.sections.coverage import coverage_section, rigs_section
from tracking.report.sections.failures import FILE as FAILURES
from tracking.report.sections.failures import failures_section
from tracking.report.sections.generalist import generalist_section
from tracking.report.sections.objects import (
    by_distance_section,
    by_sector_section,
    individuals_section,
)
from tracking.report.sections.placements import agreement_section, placements_section
from tracking.report.sections.predictors import predictors_section
from tracking.report.sections.promotion import promotion_section
from tracking.report.sections.published import published_section
from tracking.report.sections.recorded_clouds import recorded_clouds_section
from tracking.report.sections.requirements import requirements_section
from tracking.report.sections.sampling_error import sampling_error_section
from tracking.report.sections.sensitivity import sensitivity_section
from tracking.report.sections.training_cost import training_cost_section
from tracking.report.sections.where_time_went import reduced_batches, where_time_went
from tracking.run_folders.arrays import FailureFrames
from tracking.run_folders.sweep import RunFolder

_log = logging.getLogger(__name__)
FIGURES = "figures"
"""Folder of a run for its figures as files."""
_PAGES = {"decision.html": "Decision", "report.html": "Research report"}


def build_report(run: Path) -> Path:
    """Write the pages of the run folder `run` into it, and return the path of the report.

    Raises ValueError: `run` is no run folder."""
    folder = RunFolder.read(run)
    return write_report(Analysis(folder), folder.failures)


def write_report(analysis: Analysis, frames: FailureFrames | None) -> Path:
    """Write the pages of an analysis into its run folder, and return the path of the report.

    `report.html` and, with results, `decision.html` and `failures.html` are one file each that
    loads nothing from a network, see `tracking.pages.html_page`. `report.md` and `tables/` hold the
    tables of the report, rounded and raw, and `figures/` pictures for `report.md`. `frames` are
    those of `Analysis.pair`; frames of other rigs, as of an older run folder, are ignored."""
    run, answer = analysis.run, analysis.answer
    by_name = dict(_sections(analysis))
    sections = list(by_name.values())
    for section in sections:
        section.tables = [table.without_dashes() for table in section.tables]
    statements = [
        s for recommended in analysis.recommended for s in recommended.statements.values()
    ]
    statements = statements or [
        statement for group in analysis.groups for statement in surrogate_statements(run, group)
    ]
    extent, warnings = _extent(run), _warnings(analysis)
    pages.write_csv_files(run.path / pages.FOLDER, sections)
    failures = _write_failures(analysis, frames, by_name, extent)
    decision = write_decision(analysis, extent, warnings, failures)
    sweep = run.sweep.model_dump(
        mode="json", by_alias=True, exclude_unset=True, exclude={"placements", "site"}
    )
    page = pages.write_page(
        run.path / "report.html",
        Path(__file__).with_name("report.html"),
        [*_pictures(by_name), *sections],
        name=run.sweep.name,
        run=run,
        decision=decision.name if decision else None,
        statements=statements,
        answer=answer,
        required=analysis.recommended[0].required if answer else "",
        extent=extent,
        warnings=warnings,
        sweep=json.dumps(sweep, indent=2, default=str),
    )
    for name, picture in write_pictures(analysis, run.path / FIGURES, by_name):
        by_name[name].pictures.append(f"{FIGURES}/{picture.name}")
    blocks = [*_first_blocks(statements, answer, extent, warnings)]
    verbatim = {"Command": run.sweep.command, "Configuration": run.config}
    pages.write_markdown(
        run.path / "report.md", run.sweep.name, blocks, sections, verbatim, page.name
    )
    return page


def _warnings(analysis: Analysis) -> list[str]:
    run, duplicates = analysis.run, analysis.duplicates
    warnings = cautions(analysis)
    if duplicates:
        named = some([f"{name} is {first}" for name, first in duplicates.items()])
        warnings.append(f"The same rig under two names is counted once: {named}.")
    return warnings + reduced_batches(run.tasks)


def _first_blocks(
    statements: Iterable[Statement], answer: Answer | None, extent: str, warnings: Sequence[str]
) -> Iterator[str]:
    """Yield what report.md begins with: the headlines and the warnings, blocks of Markdown."""
    yield pages.escaped(extent)
    for statement in statements:
        text = f"{statement.metric}: {statement.lead}. {statement.certainty}".rstrip()
        heading, best, text = map(pages.escaped, (statement.heading, statement.best, text))
        yield f"**{heading}: {best}.** {text}"
    if answer is not None and len(answer.leads) > 1:
        yield f"**{pages.escaped(answer.certainty)}**"
    if answer is not None and answer.command:
        yield from ("For more evidence, run:", pages.verbatim(answer.command))
    if warnings:
        yield f"Reasons for doubt: {len(warnings)}"
    yield from (f"> Warning: {pages.escaped(warning)}" for warning in warnings)


_MakeSection = Callable[[Analysis], Section | None]
_BUILT_IN: tuple[_MakeSection, ...] = (
    coefficient_map_section,
    best_section,
    accuracy_section,
    placements_section,
    by_class_section,
    requirements_section,
    agreement_section,
    promotion_section,
    predictors_section,
    reliability_section,
    generalist_section,
    recorded_clouds_section,
    published_section,
    sensitivity_section,
    tilts_section,
    density_section,
    rigs_section,
    coverage_section,
    clouds_section,
    individuals_section,
    by_distance_section,
    by_sector_section,
    failures_section,
    sampling_error_section,
    training_cost_section,
    where_time_went,
)
SECTIONS: Registry[_MakeSection] = Registry(
    "lidarplace.sections", {make.__name__.removesuffix("_section"): make for make in _BUILT_IN}
)
"""Sections of the page from top to bottom; those of other packages follow."""


def _sections(analysis: Analysis) -> Iterator[tuple[str, Section]]:
    for name, make in SECTIONS.installed().items():
        try:
            with SECTIONS.calls(name):
                if not isinstance(section := make(analysis), Section | None):
                    raise InputError(f"returns no Section, but {type(section).__name__}")
        except InputError as error:
            if name in SECTIONS.own:
                raise
            _log.warning("plug-in left out: section %s", error)
            continue
        empty = section is None or not (section.figures or section.tables)
        if section is not None and not (empty and analysis.run.sweep.detections):
            first = "placements" if analysis.run.results.empty else "best"
            section.folded = section.place == "page" and name != first
            yield name, section


def _pictures(by_name: Mapping[str, Section]) -> Iterator[Section]:
    """Move figures of placements and of error against run time to the first screens."""
    for section in filter(
        None, (by_name.get("best", by_name.get("rigs")), by_name.get("accuracy"))
    ):
        figures, section.figures = section.figures[:1], section.figures[1:]
        yield Section(section.title, section.notes[:1], figures, place="picture")


def _write_failures(
    analysis: Analysis, frames: FailureFrames | None, by_name: Mapping[str, Section], extent: str
) -> Section | None:
    """Write the page of the compared rigs, or remove that of an earlier run; return its section."""
    run, pair = analysis.run, analysis.pair
    if pair is None:
        (run.path / FAILURES).unlink(missing_ok=True)
        return None
    if frames is not None and not frames.are_of(pair.rigs, pair.objects["object"]):
        frames = None
    section = by_name["failures"]
    write_failures(run.path / FAILURES, run, pair, frames, section, extent, _PAGES)
    return section


def _extent(run: RunFolder) -> str:
    """Say in one line how much was compared."""
    pruned = int((run.trials["status"] == "pruned").sum())
    frames = run.sweep.frames
    trained = "" if run.sweep.detections else f"{frames.train:,} training and "
    parts = [
        f"{len(run.placements)} placements, {len(run.trials)} trials",
        f"{pruned} of them pruned by promotion" if pruned else "",
        f"{trained}{frames.test:,} test frames{_tested_objects(run)}",
        pictured(run),
    ]
    return f"{', '.join(filter(None, parts))}."


def _tested_objects(run: RunFolder) -> str:
    """Count the objects of the test frames; "" where unknown or where settings differ in them."""
    if run.individuals is None or set(run.axes) & set(run.individuals.columns):
        return ""
    counts = count_individuals(run.individuals[run.individuals["split"] == "test"])
    boxes, individuals = counts["boxes"].sum(), counts["individuals"].sum()
    return f" with {boxes:,} boxes of {individuals:,} individuals" if boxes else ""
