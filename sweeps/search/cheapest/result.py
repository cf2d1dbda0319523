"""Output of the cheapest rig: printed, and as files in the run folder."""

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
from sweeps.search.cheapest.cheapest_rig import CheapestResult, Recall
from sweeps.search.cheapest.polish import needed_for
from sweeps.search.cheapest.rig_check import check_rig, cost_of
from sweeps.search.greedy.certificate import slots_of
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig
from tracking.labels import digits
from tracking.pages.requirements import verdict_table
from tracking.search_report.headline import pairs_sentence

_UNITS = {"lidars": "LiDARs", "price": "", "power": "W", "height": "m"}


def proof(problem: SearchProblem, chosen: CheapestResult) -> str:
    """Describe the proof about all rigs of the grid in a sentence."""
    settings = problem.file.search.cheapest
    judged, rows, cuts = (chosen.counts.get(key, 0) for key in ("judged", "rows", "cuts"))
    work = f"rigs checked: {judged:,}, rows: {rows:,}, cuts: {cuts:,}; {chosen.seconds:.0f} s"
    if chosen.rig is None:
        if chosen.bound == math.inf:
            return f"No rig of the grid meets everything, which is proven ({work})."
        return (
            f"No rig of the grid that meets everything was found in {settings.seconds:g} s; one "
            f"would cost at least {_cost_text(problem, chosen.bound)} ({work})."
        )
    named = "" if settings.by == "lidars" else f"{settings.by} "
    cost = f"{named}{_cost_text(problem, chosen.cost)}"
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
        f"{cost}; no rig of the grid costs less than {_cost_text(problem, chosen.bound)}, a gap of "
        f"{100 * chosen.gap:.3g} %, when search.cheapest.seconds were over ({work})."
    )


def _cost_text(problem: SearchProblem, cost: float) -> str:
    unit = _UNITS[problem.file.search.cheapest.by]
    return f"{cost:.6g} {unit.removesuffix('s') if cost == 1 else unit}".strip()


def print_chosen(
    console: Console,
    problem: SearchProblem,
    chosen: CheapestResult,
    rig: Rig | None,
    folder: Path,
    recall: Recall | None,
) -> None:
    """Print the rig, why it needs each LiDAR, and what binds; or the rig that lacks least."""
    console.print(proof(problem, chosen), style="bold", soft_wrap=True)
    printed = rig or chosen.closest
    if printed is None:
        console.print("No candidate keeps the constraints.")
        return
    rig_check = check_rig(printed, problem)
    if rig is None:
        console.print("The closest rig that was checked:")
    elif rig != chosen.rig:
        assert chosen.rig is not None
        before = check_rig(chosen.rig, problem)
        console.print(
            f"Refined between the candidates: {_cost_text(problem, cost_of(rig, problem))}, least "
            f"margin {before.margin:.3g} → {rig_check.margin:.3g}"
        )
    why = [""] * len(printed) if rig is None else needed_for(problem, rig, recall)
    console.print(_lidars(printed, why))
    if pairs := _mirrored_zones(problem, printed):
        console.print(pairs_sentence(pairs), soft_wrap=True)
    if rig_check.outcomes:
        worst = worst_cases(case_table(rig_check.outcomes), [])
        worst = worst.iloc[(worst["value"] / worst["at_least"]).argsort(kind="stable")]
        binding = verdict_table(worst.reset_index(drop=True), [])
        words = {binding.head[i] for i in binding.words}
        title = "What binds, least to spare first"
        console.print(table(title, binding.head, binding.rows, words=words))
    others = [c.name for c in rig_check.broken if not c.name.startswith("requirement.")]
    if others:
        console.print(f"broken: {', '.join(others)}")
    if chosen.value is not None:
        console.print(f"{problem.file.search.objective[0].name}: {chosen.value:.1f}")
    if rig is not None:
        console.print(f"{folder / 'placement.yaml'}", soft_wrap=True)


def _mirrored_zones(problem: SearchProblem, rig: Rig) -> list[str]:
    """Return the zones of the rig's mirrored pairs."""
    pairs = (place.lidar.zone for place in slots_of(rig, problem) or () if place.slot.pair)
    return sorted({*pairs})


def _lidars(rig: Rig, why: Sequence[str]) -> Table:
    """Return a table with a row for each LiDAR, and why the rig needs it."""
    rows = []
    for lidar, reason in zip(rig, why, strict=True):
        mount = lidar.mount
        places = (digits(value, "z.3f") for value in mount.position.tolist())
        turns = (digits(math.degrees(a), "z.1f") for a in (mount.roll, mount.pitch, mount.yaw))
        rows.append([lidar.model, lidar.zone or "fixed", *places, *turns, reason])
    head = ["model", "zone", "x", "y", "z", "roll °", "pitch °", "yaw °", "without it fails"]
    return table("LiDARs", head, rows, words={"zone", head[-1]})


def write_chosen(
    problem: SearchProblem, chosen: CheapestResult, rig: Rig | None, command: str
) -> Path:
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
    problem: SearchProblem, chosen: CheapestResult, rig: Rig | None, command: str
) -> dict[str, object]:
    """Return the whole result for a script; infinite numbers are null."""
    printed = rig or chosen.closest
    rig_check = None if printed is None else check_rig(printed, problem)
    cases = None if rig_check is None or not rig_check.outcomes else case_table(rig_check.outcomes)
    numbers = {key: getattr(chosen, key) for key in ("cost", "bound", "fewest", "seconds", "value")}
    refined_cost = math.inf if rig is None else cost_of(rig, problem)
    numbers |= {**chosen.counts, "gap": chosen.gap, "refined_cost": refined_cost}
    return {
        "command": command,
        "by": problem.file.search.cheapest.by,
        "found": rig is not None,
        **{k: None if v is None or not math.isfinite(v) else v for k, v in numbers.items()},
        "lidars": [asdict(lidar) for lidar in printed or ()],
        "mirrored": [] if printed is None else _mirrored_zones(problem, printed),
        "margin": None if rig_check is None or math.isinf(rig_check.margin) else rig_check.margin,
        "broken": [] if rig_check is None else [c.name for c in rig_check.broken],
        "cases": [] if cases is None else json.loads(cases.to_json(orient="records")),
    }
