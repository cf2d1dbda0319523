"""The section of the requirements: which rig meets which, and the ground where one fails."""

from collections.abc import Mapping, Sequence

from lidarplace.requirements.tables import worst_cases
from tracking.findings.groups import pictured, worst_requirements
from tracking.pages.requirements import ALONE, counted, draw_failures, in_short, verdict_table
from tracking.pages.section import MOST_ROWS, Section, Table
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder


def requirements_section(analysis: Analysis) -> Section | None:
    """Every rig and requirement, and pictures of what fails; None if nothing was required."""
    run, cases = analysis.run, analysis.run.requirements
    if cases is None or cases.empty:
        return None
    rig = ["placement", *(axis for axis in run.axes if axis in cases.columns)]
    worst = worst_cases(cases, rig)
    table = verdict_table(worst, rig, name="requirements", data=cases)
    section = Section("Requirements", [counted(worst), ALONE], folded=True)
    section.tables = [table.first(MOST_ROWS)]
    _draw(section, run, analysis.order)
    return section


def rigs_requirements_section(
    run: RunFolder, rigs: Sequence[str], setting: Mapping[str, object]
) -> Section | None:
    """A table of rigs in rows and requirements in columns, and where the first one fails. None if
    nothing was required. `setting` is of the axes."""
    found = worst_requirements(run, setting)
    found = found[found["placement"].isin(rigs)]
    if found.empty:
        return None
    cells = {(row["placement"], row["requirement"]): row for row in found.to_dict("records")}
    names = list(dict.fromkeys(found["requirement"]))
    shown = [name for name in rigs if name in set(found["placement"])]
    rows = tuple((rig, *(in_short(cells[rig, name]) for name in names)) for rig in shown)
    failed = frozenset(
        (shown.index(rig), 1 + names.index(name))
        for (rig, name), row in cells.items()
        if not row["met"]
    )
    head, caption = ("placement", *names), "What is required, in the worst case"
    table = Table(caption, head, rows, best=failed, words=frozenset(range(len(head))))
    section = Section("Requirements", [counted(found)], tables=[table], folded=True)
    _draw(section, run, shown[:1])
    return section


def _draw(section: Section, run: RunFolder, order: Sequence[str]) -> None:
    """What placements fail, in their order, at the setting that is pictured."""
    found = worst_requirements(run, run.sweep.pictured)
    draw_failures(section, found, "placement", order, run.placements, run.grounds)
    if section.figures and pictured(run):
        section.notes.append(f"Pictures are {pictured(run)}.")
