"""What was chosen: printed, and as files in the run folder."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from lidarplace.command_line.terminal import table
from lidarplace.files.atomic import write_text
from lidarplace.requirements.tables import case_table, worst_cases
from sweeps.search.cheapest.choose import Chosen, Recall, cost_of, verdict_of
from sweeps.search.cheapest.polish import needed_for
from sweeps.search.problem.choice import Choices
from sweeps.search.problem.problem import Problem
from tracking.labels import digits
from tracking.pages.requirements import verdict_table

_UNITS = {"lidars": "LiDARs", "price": "", "power": "W", "height": "m"}


def proof(problem: Problem, chosen: Chosen) -> str:
    """What is known of all rigs of the grid, a sentence."""
    settings = problem.file.search.cheapest
    judged, rows, cuts = (chosen.counts.get(key, 0) for key in ("judged", "rows", "cuts"))
    work = f"rigs judged: {judged:,}, rows: {rows:,}, cuts: {cuts:,}; {chosen.seconds:.0f} s"
    if chosen.rig is None:
        if chosen.bound == math.inf:
            return f"No rig of the grid meets everything, which is proven ({work})."
        return (
            f"No rig of the grid that meets everything was found in {settings.seconds:g} s; one "
            f"would cost at least {_told(problem, chosen.bound)} ({work})."
        )
    named = "" if settings.by == "lidars" else f"{settings.by} "
    cost = f"{named}{_told(problem, chosen.cost)}"
    if chosen.gap == 0.0:
        number, proven = len(chosen.rig), "of the grid, which is proven"
        if settings.by != "lidars":
            cost += f" with {number} LiDAR{'s' * (number > 1)}"
        if chosen.fewest == number:
            return f"{cost}: the least {proven} ({work})."
        return (
            f"{cost}: the least {settings.by} {proven}; at that {settings.by} at least "
            f"{chosen.fewest:g} are needed, when search.cheapest.seconds were over ({work})."
        )
    return (
        f"{cost}; no rig of the grid costs less than {_told(problem, chosen.bound)}, a gap of "
        f"{100 * chosen.gap:.3g} %, when search.cheapest.seconds were over ({work})."
    )


def _told(problem: Problem, cost: float) -> str:
    unit = _UNITS[problem.file.search.cheapest.by]
    return f"{cost:.6g} {unit.removesuffix('s') if cost == 1 else unit}".strip()


def print_chosen(
    console: Console,
    problem: Problem,
    chosen: Chosen,
    rig: Choices | None,
    folder: Path,
    recall: Recall | None,
) -> None:
    """The rig, why it needs each LiDAR, and what binds; or the one that lacks least."""
    console.print(proof(problem, chosen), style="bold", soft_wrap=True)
    shown = rig or chosen.closest
    if shown is None:
        console.print("No candidate keeps the constraints.")
        return
    verdict = verdict_of(shown, problem)
    if rig is None:
        console.print("The closest that was judged:")
    elif rig != chosen.rig:
        assert chosen.rig is not None
        before = verdict_of(chosen.rig, problem)
        console.print(
            f"Refined between the candidates: {_told(problem, cost_of(rig, problem))}, least "
            f"margin {before.margin:.3g} → {verdict.margin:.3g}"
        )
    why = [""] * len(shown) if rig is None else needed_for(problem, rig, recall)
    console.print(_lidars(shown, why))
    if verdict.outcomes:
        worst = worst_cases(case_table(verdict.outcomes), [])
        worst = worst.iloc[(worst["value"] / worst["at_least"]).argsort(kind="stable")]
        told = verdict_table(worst.reset_index(drop=True), [])
        words = {told.head[i] for i in told.words}
        console.print(table("What binds, least to spare first", told.head, told.rows, words=words))
    others = [own.name for own in verdict.broken if not own.name.startswith("requirement.")]
    if others:
        console.print(f"broken: {', '.join(others)}")
    if chosen.value is not None:
        console.print(f"{problem.file.search.objective[0].name}: {chosen.value:.1f}")
    if rig is not None:
        console.print(f"{folder / 'placement.yaml'}", soft_wrap=True)


def _lidars(rig: Choices, why: Sequence[str]) -> Table:
    """A row for each LiDAR, and why the rig needs it."""
    rows = []
    for lidar, reason in zip(rig, why, strict=True):
        own = lidar.mount
        places = (digits(value, "z.3f") for value in own.position.tolist())
        turns = (digits(math.degrees(a), "z.1f") for a in (own.roll, own.pitch, own.yaw))
        rows.append([lidar.model, lidar.zone or "fixed", *places, *turns, reason])
    head = ["model", "zone", "x", "y", "z", "roll °", "pitch °", "yaw °", "without it fails"]
    return table("LiDARs", head, rows, words={"zone", head[-1]})


def write_chosen(problem: Problem, chosen: Chosen, rig: Choices | None, command: str) -> Path:
    """Write `placement.yaml`, if there is a rig, and `cheapest.json`. Returns their folder."""
    folder = problem.folder / "cheapest"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "placement.yaml").unlink(missing_ok=True)
    content = as_json(problem, chosen, rig, command)
    write_text(folder / "cheapest.json", json.dumps(content, indent=1))
    if rig is not None:
        write_text(folder / "placement.yaml", problem.placement_text(rig))
    return folder


def as_json(
    problem: Problem, chosen: Chosen, rig: Choices | None, command: str
) -> dict[str, object]:
    """Everything that is known, for a script; what is infinite is null."""
    shown = rig or chosen.closest
    verdict = None if shown is None else verdict_of(shown, problem)
    cases = None if verdict is None or not verdict.outcomes else case_table(verdict.outcomes)
    known = {key: getattr(chosen, key) for key in ("cost", "bound", "fewest", "seconds", "value")}
    known |= chosen.counts
    known |= {"gap": chosen.gap, "refined_cost": math.inf if rig is None else cost_of(rig, problem)}
    return {
        "command": command,
        "by": problem.file.search.cheapest.by,
        "found": rig is not None,
        **{k: None if v is None or not math.isfinite(v) else v for k, v in known.items()},
        "lidars": [asdict(lidar) for lidar in shown or ()],
        "margin": None if verdict is None or math.isinf(verdict.margin) else verdict.margin,
        "broken": [] if verdict is None else [own.name for own in verdict.broken],
        "cases": [] if cases is None else json.loads(cases.to_json(orient="records")),
    }
