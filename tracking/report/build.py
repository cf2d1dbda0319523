"""Build the pages of a run folder: the report, next to it Markdown and tables, and the decision."""

import json
import logging
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.base.registry import Registry
from tracking.findings.failures import Failures
from tracking.findings.groups import copies, pictured, without
from tracking.findings.individuals import count_individuals
from tracking.labels import some
from tracking.pages import page as pages
from tracking.pages.section import Section
from tracking.report.analysis import Analysis as Analysis
from tracking.report.cautions import cautions
from tracking.report.decision.build import write_decision
from tracking.report.failures import write_failures
from tracking.report.headline import surrogate_verdicts
from tracking.report.sections.ablations import density_section, tilts_section
from tracking.report.sections.accuracy import accuracy_section
from tracking.report.sections.best import best_section, by_class_section
from tracking.report.sections.ceiling import reliability_section
from tracking.report.sections.clouds import clouds_section
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
from tracking.run_folders.sweep import RunFolder

_log = logging.getLogger(__name__)
_PAGES = {"decision.html": "Decision", "report.html": "Research report"}


def build_report(run: Path) -> Path:
    """Write the pages of the run folder `run` into it; return the report.

    `report.html` and, with results, `decision.html` and `failures.html` are one file each that
    loads nothing from a network, see `tracking.pages.page`. `report.md` and `tables/` hold the
    tables of the report, rounded and raw. Raises ValueError: `run` is no run folder.
    """
    complete = RunFolder.read(run)
    same = copies(complete)
    found = Analysis(without(complete, set(same)))
    folder = found.run
    by_name = dict(_sections(found))
    sections = list(by_name.values())
    failures = by_name["failures"] if found.pair else None
    for section in sections:
        section.tables = [table.without_dashes() for table in section.tables]
    stated = [v for own in found.recommended for v in own.verdicts.values()]
    stated = stated or [v for group in found.groups for v in surrogate_verdicts(folder, group)]
    said = found.answer
    extent = _extent(folder)
    warnings = cautions(folder)
    if same:
        named = some([f"{name} is {first}" for name, first in same.items()])
        warnings.append(f"The same rig under two names is counted once: {named}.")
    warnings += reduced_batches(folder.tasks)
    facts = folder.sweep.model_dump(
        mode="json", by_alias=True, exclude_unset=True, exclude={"placements"}
    )
    pages.write_csv_files(folder.path / pages.FOLDER, sections)
    _write_failures(folder, found.pair, failures, extent)
    decision = write_decision(found, extent, warnings, failures)
    page = pages.write_page(
        folder.path / "report.html",
        Path(__file__).with_name("report.html"),
        [_picture(by_name), *sections],
        name=folder.sweep.name,
        run=folder,
        decision=decision.name if decision else None,
        verdicts=stated,
        answer=said,
        required=found.recommended[0].required(folder) if said else "",
        extent=extent,
        warnings=warnings,
        sweep=json.dumps(facts, indent=2, default=str),
    )
    first = [pages.escaped(extent)]
    for card in stated:
        told = f"{card.metric}: {card.lead}. {card.sure}".rstrip()
        heading, best, told = map(pages.escaped, (card.heading, card.best, told))
        first.append(f"**{heading}: {best}.** {told}")
    if said is not None and len(said.leads) > 1:
        first.append(f"**{pages.escaped(said.sure)}**")
    if said is not None and said.command:
        first += ["For more evidence, run:", pages.verbatim(said.command)]
    first += [f"Reasons for doubt: {len(warnings)}"] if warnings else []
    first += [f"> Warning: {pages.escaped(warning)}" for warning in warnings]
    last = {"Command": folder.sweep.command, "Configuration": folder.config}
    name = folder.sweep.name
    pages.write_markdown(folder.path / "report.md", name, first, sections, last, page.name)
    return page


_Make = Callable[[Analysis], Section | None]
_OURS: tuple[_Make, ...] = (best_section, placements_section, by_class_section)
_OURS += (requirements_section, agreement_section, promotion_section, predictors_section)
_OURS += (reliability_section, generalist_section, recorded_clouds_section, published_section)
_OURS += (sensitivity_section, tilts_section, density_section, rigs_section, coverage_section)
_OURS += (clouds_section, individuals_section, by_distance_section, by_sector_section)
_OURS += (failures_section, accuracy_section, sampling_error_section, training_cost_section)
_OURS += (where_time_went,)
SECTIONS: Registry[_Make] = Registry(
    "lidarplace.sections", {make.__name__.removesuffix("_section"): make for make in _OURS}
)
"""The page from top to bottom; what other packages add comes after ours."""


def _sections(found: Analysis) -> Iterator[tuple[str, Section]]:
    for name, make in SECTIONS.installed().items():
        try:
            with SECTIONS.calls(name):
                if not isinstance(section := make(found), Section | None):
                    raise InputError(f"returns no Section, but {type(section).__name__}")
        except InputError as error:
            if name in SECTIONS.own:
                raise
            _log.warning("plug-in left out: section %s", error)
            continue
        if section is not None:
            section.folded = name != ("placements" if found.run.results.empty else "best")
            yield name, section


def _picture(by_name: Mapping[str, Section]) -> Section:
    """For the first screen: the first figure of what is decided by, of which it is taken."""
    own = by_name.get("best") or by_name.get("rigs") or Section("")
    figures, own.figures = own.figures[:1], own.figures[1:]
    return Section(own.title, own.notes[:1], figures, top=True)


def _write_failures(
    run: RunFolder, pair: Failures | None, section: Section | None, extent: str
) -> None:
    """The page of the rigs that are compared, or none of an earlier run."""
    if pair is None or section is None:
        (run.path / FAILURES).unlink(missing_ok=True)
        return
    frames = run.failures
    if frames is not None and not frames.are_of(pair.rigs, pair.objects["object"]):
        frames = None
    file = run.path / FAILURES
    write_failures(file, run, pair, frames, section, extent, _PAGES)


def _extent(run: RunFolder) -> str:
    """How much was compared, in one line."""
    pruned = int((run.trials["status"] == "pruned").sum())
    frames = run.sweep.frames
    parts = [
        f"{len(run.placements)} placements, {len(run.trials)} trials",
        f"{pruned} of them pruned by promotion" if pruned else "",
        f"{frames.train} training and {frames.test} test frames{_met(run)}",
        pictured(run),
    ]
    return f"{', '.join(filter(None, parts))}."


def _met(run: RunFolder) -> str:
    """The objects of the test frames; "" where they are unknown or differ with the setting."""
    if run.individuals is None or set(run.axes) & set(run.individuals.columns):
        return ""
    counts = count_individuals(run.individuals[run.individuals["split"] == "test"])
    boxes, individuals = counts["boxes"].sum(), counts["individuals"].sum()
    return f" with {boxes:,} boxes of {individuals:,} individuals" if boxes else ""
