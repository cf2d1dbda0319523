"""Check rigs against the requirements of their vehicle: `lidarplace requirements rigs.yaml`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lidarplace.command_line.terminal import Terminal, output, print_warnings, say, table
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from lidarplace.rigs.scan_timing import STILL_WORLD
from sweeps.options import DryRunOption, SetOption

if TYPE_CHECKING:
    import pandas as pd

    from lidarplace.requirements.check_requirements import RequirementResult
    from sweeps.configuration.requirements_file import RequirementsCheck
    from tracking.pages.section import Section

MOST_FIGURES = 120
"""Most figures of a page; those that fail come first."""

app = new_app()


@verb(
    app,
    "examples/requirements.yaml",
    "examples/requirements.yaml --dry-run",
    "examples/sensor_needs.yaml",
    failed="a rig fails a requirement",
)
def requirements(
    config: Annotated[Path, typer.Argument(help="YAML file of rigs and requirements")],
    set_: SetOption = None,
    dry_run: DryRunOption = False,
    out: Annotated[
        Path, typer.Option(metavar="PATH", help="path of the results, without suffix")
    ] = Path("requirements"),
    as_json: JsonOption = False,
) -> None:
    """Place objects all around the vehicle, and check that each rig sees enough of them.

    No traffic is needed. Writes OUT.csv, a row for each rig, requirement and case, and OUT.html
    with pictures of the ground around the vehicle."""
    from rich.progress import track

    from lidarplace.requirements.check_requirements import check_requirements
    from lidarplace.requirements.tables import by_rig, case_table, worst_cases
    from sweeps.configuration.requirements_file import read_requirements_check
    from tracking.pages.requirements import counted, verdict_table

    with checked_input():
        check = read_requirements_check(config, set_ or [])
        if dry_run:
            _print_plan(check, as_json)
            return
        console = Terminal(stderr=True)
        if any(rig.takes_time for rig in check.rigs):
            print_warnings(console, [STILL_WORLD], "")
        rigs = track(check.rigs, "rigs", console=console, disable=not console.is_terminal)
        outcomes = [
            check_requirements(check.layouts, rig, check.layouts[0].vehicle, further)
            for rig, further in zip(rigs, check.further, strict=True)
        ]
        names = (rig.name for rig in check.rigs)
        cases = by_rig(dict(zip(names, map(case_table, outcomes), strict=True)))
        worst = worst_cases(cases, ["rig"])
        paths = _write(check, outcomes, cases, worst, out)
    if as_json:
        rows = [_as_json(outcome) for of_rig in outcomes for outcome in of_rig]
        print_json({"files": paths, "outcomes": rows})
    else:
        printed = verdict_table(worst, ["rig"])
        words = {printed.head[i] for i in printed.words}
        output().print(table(None, printed.head, printed.rows, words=words))
        say(f"{counted(worst)} {', '.join(paths.values())}")
    if not worst["met"].all():
        raise typer.Exit(1)


def _print_plan(check: RequirementsCheck, as_json: bool) -> None:
    from lidarplace.requirements.tables import extents
    from sweeps.results.dry_run import extent_table

    plan = extents(check.layouts)
    if as_json:
        print_json({"rigs": [rig.name for rig in check.rigs], "requirements": plan})
        return
    say(f"rigs: {', '.join(rig.name for rig in check.rigs)}")
    output().print(extent_table(plan))


def _as_json(outcome: RequirementResult) -> dict[str, Any]:
    from lidarplace.requirements.tables import case_row

    wanted = outcome.requirement
    return {
        "rig": outcome.rig,
        "requirement": wanted.name,
        "met": outcome.met,
        "measure": wanted.measured,
        "at_least": wanted.least,
        "for": wanted.share,
        "cases": [case_row(outcome, case) for case in outcome.cases],
    }


def _write(
    check: RequirementsCheck,
    outcomes: Sequence[Sequence[RequirementResult]],
    cases: pd.DataFrame,
    worst: pd.DataFrame,
    out: Path,
) -> dict[str, str]:
    """Write the table of all cases, and a page of pictures. Returns the paths by suffix."""
    from lidarplace.files.tables import write_csv
    from tracking.pages.html_page import SECTIONS_ALONE, write_page

    paths = {suffix: out.with_name(f"{out.name}.{suffix}") for suffix in ("csv", "html")}
    out.parent.mkdir(parents=True, exist_ok=True)
    write_csv(cases, paths["csv"])
    sections = list(_sections(check, outcomes, worst))
    write_page(paths["html"], SECTIONS_ALONE, sections, name=out.name)
    return {suffix: str(path) for suffix, path in paths.items()}


def _picture(check: RequirementsCheck) -> Section:
    """Draw the rigs on the vehicle, with the ground of the first ones by expected recall."""
    from lidarplace.logs.boxes import CLASSES
    from tracking.figures.kit.grounds import ground_note, with_grounds
    from tracking.figures.kit.rig_picture import PicturedRig, axes_and_posts, rig_picture
    from tracking.pages.section import Section

    pictured = {rig.name: PicturedRig.of(rig.mounts) for rig in check.rigs}
    placements = {rig.name: rig for rig in check.rigs}
    pictured = with_grounds(pictured, placements, check.layouts[0].vehicle, CLASSES)
    notes = [axes_and_posts(check.vehicle), ground_note(pictured)]
    return Section("The rigs", notes, [rig_picture(pictured, check.vehicle)], columns=1)


def _sections(
    check: RequirementsCheck, outcomes: Sequence[Sequence[RequirementResult]], worst: pd.DataFrame
) -> Iterator[Section]:
    from lidarplace.mounting.outline import outline
    from lidarplace.requirements.tables import Ground
    from tracking.pages.requirements import COLOURS, alone, counted, requirement_map, verdict_table
    from tracking.pages.section import Section

    rigs = {rig.name: rig for rig in check.rigs}
    results = {
        (result.rig, result.requirement.name): result for of_rig in outcomes for result in of_rig
    }
    pictured = worst.sort_values("met", kind="stable").head(MOST_FIGURES)
    first = Section(
        "Requirements",
        [counted(worst), alone(check.vehicle)],
        tables=[verdict_table(worst, ["rig"])],
    )
    if len(pictured) < len(worst):
        first.notes.append(f"Pictures of {len(pictured)} of them, those that fail first.")
    first.notes += [COLOURS] if len(pictured) else []
    yield first
    yield _picture(check)
    for layout in check.layouts:
        name = layout.requirement.name
        if layout.requirement.common_view is not None:
            continue
        figures = [
            requirement_map(
                row,
                Ground.of(results[row["rig"], name]),
                row["rig"],
                rigs[row["rig"]].mounts,
                outline(check.vehicle),
                check.vehicle,
            )
            for row in pictured[pictured["requirement"] == name].to_dict("records")
        ]
        if figures:
            yield Section(name, figures=figures)
