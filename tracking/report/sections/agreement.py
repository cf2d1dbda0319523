"""The section of a sweep without detectors: do the surrogates agree?"""

from __future__ import annotations

from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.surrogate_agreement import surrogate_agreement
from tracking.findings.groups import Group, has_detectors
from tracking.findings.paired import with_sums
from tracking.findings.summary import surrogates_of
from tracking.pages.section import Section
from tracking.run_folders.sweep import RunFolder


def agreement_section(run: RunFolder, found: list[Group]) -> Section | None:
    """Rank agreement of the surrogates; None for a sweep that trained a detector."""
    if has_detectors(run):
        return None
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
