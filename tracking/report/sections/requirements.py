"""Requirements: which rig meets which, and the ground where one fails."""

from collections.abc import Mapping, Sequence

from lidarplace.requirements.tables import worst_cases
from tracking.findings.groups import pictured, worst_requirements
from tracking.pages.requirements import alone, counted, draw_verdicts, in_short, verdict_table
from tracking.pages.section import MOST_ROWS, Section, Table
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder


def requirements_section(analysis: Analysis) -> Section | None:
    """Show every rig and requirement, and pictures of what fails; None if nothing was required."""
    run, cases = analysis.run, analysis.run.requirements
    if cases is None or cases.empty:
        return None
    rig = ["placement", *(axis for axis in run.axes if axis in cases.columns)]
    worst = worst_cases(cases, rig)
    table = verdict_table(worst, rig, name="requirements", data=cases)
    section = Section("Requirements", [counted(worst), alone(run.sweep.body)], folded=True)
    section.tables = [table.first(MOST_ROWS)]
    _draw(section, run, analysis.order)
    return section


def rigs_requirements_section(
    run: RunFolder, rigs: Sequence[str], setting: Mapping[str, object]
) -> Section | None:
    """Show rigs in rows and requirements in columns, and where the first one fails.

    None if nothing was required. `setting` is of the axes."""
    worst = worst_requirements(run, setting)
    worst = worst[worst["placement"].isin(rigs)]
    if worst.empty:
        return None
    cells = {(row["placement"], row["requirement"]): row for row in worst.to_dict("records")}
    names = list(dict.fromkeys(worst["requirement"]))
    names_of_rigs = [name for name in rigs if name in set(worst["placement"])]
    rows = tuple((rig, *(in_short(cells[rig, name]) for name in names)) for rig in names_of_rigs)
    failed = frozenset(
        (names_of_rigs.index(rig), 1 + names.index(name))
        for (rig, name), row in cells.items()
        if not row["met"]
    )
    head, caption = ("placement", *names), "What is required, in the worst case"
    table = Table(caption, head, rows, best=failed, words=frozenset(range(len(head))))
    section = Section("Requirements", [counted(worst)], tables=[table], folded=True)
    _draw(section, run, names_of_rigs[:1])
    return section


def _draw(section: Section, run: RunFolder, order: Sequence[str]) -> None:
    """Draw what placements fail, in their order, at the setting that is pictured."""
    worst = worst_requirements(run, run.sweep.pictured)
    body = run.sweep.body
    draw_verdicts(section, worst, "placement", order, run.placements, run.grounds, body)
    if section.figures and pictured(run):
        section.notes.append(f"Pictures are {pictured(run)}.")
