"""Does a rig see what its vehicle needs? `python -m sweeps.requirements rigs.yaml`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lidarplace.command_line.terminal import Terminal, output, say, table
from lidarplace.command_line.verbs import JsonOption, new_app, print_json, verb, wrong
from sweeps.options import DryRunOption, SetOption

if TYPE_CHECKING:
    import pandas as pd

    from lidarplace.requirements.judge import Finding, Outcome
    from sweeps.configuration.question import Question
    from tracking.pages.section import Section

MOST_FIGURES = 120
"""Of a page; those that fail come first."""

app = new_app()


@verb(
    app,
    "examples/requirements.yaml",
    "examples/requirements.yaml --dry-run",
    failed="a rig fails a requirement",
)
def requirements(
    config: Annotated[Path, typer.Argument(help="YAML file of rigs and requirements")],
    set_: SetOption = None,
    dry_run: DryRunOption = False,
    out: Annotated[
        Path, typer.Option(metavar="PATH", help="of the results, without suffix")
    ] = Path("requirements"),
    as_json: JsonOption = False,
) -> None:
    """Place objects all around the vehicle, and look whether each rig sees enough of them.

    No traffic is needed. Writes OUT.csv, a row for each rig, requirement and case, and OUT.html
    with pictures of the ground around the vehicle.
    """
    from rich.progress import track

    from lidarplace.requirements.judge import judge
    from sweeps.configuration.question import read_question

    try:
        question = read_question(config, set_ or [])
        if dry_run:
            _print_plan(question, as_json)
            return
        console = Terminal(stderr=True)
        rigs = track(question.rigs, "rigs", console=console, disable=not console.is_terminal)
        outcomes = [judge(question.laid, rig, question.vehicle) for rig in rigs]
        paths = _write(question, outcomes, out)
    except (ValueError, OSError) as error:
        wrong(error)
    every = [outcome for of_rig in outcomes for outcome in of_rig]
    if as_json:
        print_json({"files": paths, "outcomes": [_as_json(outcome) for outcome in every]})
    else:
        output().print(_verdicts(every))
        failed = sum(not outcome.met for outcome in every)
        say(f"{failed} of {len(every)} fail; {', '.join(paths.values())}")
    if not all(outcome.met for outcome in every):
        raise typer.Exit(1)


def _print_plan(question: Question, as_json: bool) -> None:
    plan = [
        {
            "requirement": laid.requirement.name,
            "measure": laid.requirement.measure,
            "positions": int(laid.positions.held.sum()),
            "objects": 0 if laid.roi is not None else int((laid.boxes[:, :, 0] < math.inf).sum()),
        }
        for laid in question.laid
    ]
    if as_json:
        print_json({"rigs": [rig.name for rig in question.rigs], "requirements": plan})
        return
    say(f"rigs: {', '.join(rig.name for rig in question.rigs)}")
    head = tuple(plan[0])
    output().print(table(None, head, [row.values() for row in plan], words={"measure"}))


HEAD = (
    *("rig", "requirement", "verdict", "needed", "found", "short by", "enough at"),
    *("worst place", "when"),
)
WORDS = frozenset(HEAD) - {"needed", "found", "short by", "enough at"}


def _cells(outcome: Outcome) -> tuple[str, ...]:
    """A row of the table of verdicts."""
    from tracking.numbers import digits

    wanted, worst = outcome.requirement, outcome.worst
    share = "" if wanted.share == 1.0 else f", {100 * wanted.share:g} %"
    short = wanted.least - worst.value
    place = f"x {digits(worst.x, 'z.2f')}, y {digits(worst.y, 'z.2f')}"
    if worst.heading is not None:
        place += f", {math.degrees(worst.heading):.0f}°"
    return (
        outcome.rig,
        wanted.name,
        "pass" if outcome.met else "FAIL",
        f"{wanted.least:g} {wanted.measure}{share}",
        f"{worst.value:.4g}",
        f"{short:.4g}" if short > 0 else "",
        f"{100 * worst.enough:.4g} %",
        place,
        worst.case,
    )


def _verdicts(outcomes: Sequence[Outcome]) -> Any:
    return table(None, HEAD, map(_cells, outcomes), words=WORDS)


def _row(outcome: Outcome, finding: Finding) -> dict[str, Any]:
    wanted = outcome.requirement
    return {
        "case": finding.case,
        "met": finding.value >= wanted.least,
        "value": finding.value,
        "short_by": max(0.0, wanted.least - finding.value),
        "enough": finding.enough,
        "x": finding.x,
        "y": finding.y,
        "heading_deg": None if finding.heading is None else math.degrees(finding.heading),
        "at_worst": finding.at_worst,
    }


def _as_json(outcome: Outcome) -> dict[str, Any]:
    wanted = outcome.requirement
    return {
        "rig": outcome.rig,
        "requirement": wanted.name,
        "met": outcome.met,
        "measure": wanted.measure,
        "at_least": wanted.least,
        "for": wanted.share,
        "cases": [_row(outcome, finding) for finding in outcome.findings],
    }


def _rows(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """A row for each rig, requirement and case."""
    import pandas as pd

    return pd.DataFrame(
        {
            "rig": outcome.rig,
            "requirement": outcome.requirement.name,
            "measure": outcome.requirement.measure,
            "at_least": outcome.requirement.least,
            "for": outcome.requirement.share,
            **_row(outcome, finding),
        }
        for outcome in outcomes
        for finding in outcome.findings
    )


def _write(question: Question, outcomes: Sequence[Sequence[Outcome]], out: Path) -> dict[str, str]:
    """The table of all cases, and a page of pictures. Returns the paths by suffix."""
    from lidarplace.files.atomic import replacing
    from lidarplace.files.csv import write_csv
    from tracking.pages.page import SECTIONS_ALONE, write_page

    paths = {suffix: out.with_name(f"{out.name}.{suffix}") for suffix in ("csv", "html")}
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(paths["csv"]) as partial:
        write_csv(_rows([outcome for of_rig in outcomes for outcome in of_rig]), partial)
    write_page(paths["html"], SECTIONS_ALONE, _sections(question, outcomes), name=out.name)
    return {suffix: str(path) for suffix, path in paths.items()}


def _sections(question: Question, outcomes: Sequence[Sequence[Outcome]]) -> list[Section]:
    """The verdicts, and for each requirement the ground around every rig."""
    from tracking.figures.of_rigs.requirement_map import requirement_map
    from tracking.pages.section import Section
    from tracking.pages.tables import Table

    every = [
        (outcome, rig)
        for rig, of_rig in zip(question.rigs, outcomes, strict=True)
        for outcome in of_rig
    ]
    rows = tuple(_cells(outcome) for outcome, _ in every)
    stressed = frozenset((i, 2) for i, (outcome, _) in enumerate(every) if not outcome.met)
    failed = len(stressed)
    words = frozenset(i for i, name in enumerate(HEAD) if name in WORDS)
    verdicts = Table("Each in its worst case", HEAD, rows, best=stressed, words=words)
    first = Section(
        "Requirements",
        notes=[
            f"{failed} of {len(every)} verdicts are failures. An object stands alone on level "
            "ground at each position, in the worst of its headings; what hides it is the body of "
            "the vehicle, and its other LiDARs where their size is known."
        ],
        tables=[verdicts],
    )
    shown = sorted(every, key=lambda pair: pair[0].met)[:MOST_FIGURES]
    if len(shown) < len(every):
        first.notes.append(f"Pictures of {len(shown)} of them, those that fail first.")
    sections = [first]
    for laid in question.laid:
        figures = [
            requirement_map(outcome, rig, question.vehicle)
            for outcome, rig in shown
            if outcome.requirement is laid.requirement
        ]
        if figures:
            note = (
                "What is at each position, in the worst of all cases, in terms of what is needed: "
                "orange is too little, blue is enough. The cross is the worst place; diamonds are "
                "LiDARs."
            )
            sections.append(Section(laid.requirement.name, notes=[note], figures=figures))
    return sections


if __name__ == "__main__":
    app()
