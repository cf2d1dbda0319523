"""Output of the cheapest rig: printed, and as files in the run folder."""

import json
import math
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd
from rich.console import Console

from lidarplace.command_line.terminal import table
from lidarplace.files.atomic import write_text
from lidarplace.requirements.tables import case_table, worst_cases
from sweeps.results.rigs import FILE as RIGS
from sweeps.search.cheapest.cheapest_rig import CheapestResult, Recall
from sweeps.search.cheapest.polish import needed_for
from sweeps.search.cheapest.rig_check import RigCheck, check_rig, cost_of
from sweeps.search.greedy.certificate import slots_of
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig
from tracking.labels import digits
from tracking.pages.requirements import verdict_table
from tracking.search_report.headline import pairs_sentence

FILE = "cheapest.html"
"""Name of the page."""
WHY = "without it fails"
_UNITS = {"lidars": "LiDARs", "price": "", "power": "W", "height": "m"}


@dataclass(frozen=True)
class CheapestAnswer:
    """The cheapest rig of the grid, `chosen`, the refined one, `rig`, and all that is said of it.

    `command` runs the choice again; `recall` is as for `choose.cheapest`."""

    problem: SearchProblem
    chosen: CheapestResult
    rig: Rig | None
    command: str
    recall: Recall | None

    @property
    def name(self) -> str:
        """Name of the listed rig on the page."""
        return "the closest rig" if self.rig is None else "the rig"

    @property
    def listed(self) -> Rig:
        """The rig, or the closest that was checked; empty without either."""
        return self.rig or self.chosen.closest or ()

    @cached_property
    def check(self) -> RigCheck:
        """Constraints and requirements of the listed rig."""
        return check_rig(self.listed, self.problem)

    @cached_property
    def needed_for(self) -> list[str]:
        """Constraints that fail without each LiDAR of the rig; empty texts for the closest one."""
        if self.rig is None:
            return [""] * len(self.listed)
        return needed_for(self.problem, self.rig, self.recall)

    @cached_property
    def worst(self) -> pd.DataFrame:
        """Requirements of the listed rig in their worst cases, the least to spare first."""
        if not self.listed or not self.check.outcomes:
            return pd.DataFrame()
        worst = worst_cases(case_table(self.check.outcomes), [])
        order = (worst["value"] / worst["at_least"]).argsort(kind="stable")
        return worst.iloc[order].reset_index(drop=True)

    @property
    def proof(self) -> str:
        """The proof about all rigs of the grid in a sentence."""
        return proof(self.problem, self.chosen)

    @property
    def refined(self) -> str:
        """Gain by refinement between the candidates, a sentence; "" for none."""
        before = self.chosen.rig
        if self.rig is None or before is None or self.rig == before:
            return ""
        refined = cost_text(self.problem, cost_of(self.rig, self.problem))
        if (margin := check_rig(before, self.problem).margin) < math.inf:
            refined += f", least margin {margin:.3g} → {self.check.margin:.3g} times the need"
        return f"Refined between the candidates: {refined}."

    @property
    def broken(self) -> list[str]:
        """Constraints that the listed rig breaks, without requirements."""
        names = [c.name for c in self.check.broken] if self.listed else []
        return [name for name in names if not name.startswith("requirement.")]

    @property
    def mirrored(self) -> list[str]:
        """Zones of the listed rig's mirrored pairs."""
        places = slots_of(self.listed, self.problem) or ()
        return sorted({place.lidar.zone for place in places if place.slot.pair})

    def lidar_rows(self) -> tuple[list[str], list[list[str]]]:
        """Return the head and the rows of the table of LiDARs, with why the rig needs each."""
        rows = []
        for number, (lidar, reason) in enumerate(
            zip(self.listed, self.needed_for, strict=True), start=1
        ):
            mount = lidar.mount
            places = (digits(value, "z.3f") for value in mount.position.tolist())
            turns = (digits(math.degrees(a), "z.1f") for a in (mount.roll, mount.pitch, mount.yaw))
            why = [reason] if self.rig is not None else []
            zone = lidar.zone or "fixed"
            rows.append([str(number), lidar.model, zone, *why, *places, *turns])
        head = ["LiDAR", "model", "zone", "x", "y", "z", "roll °", "pitch °", "yaw °"]
        if self.rig is not None:
            head.insert(3, WHY)
        return head, rows


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
            f"would cost at least {cost_text(problem, chosen.bound)} ({work})."
        )
    named = "" if settings.by == "lidars" else f"{settings.by} "
    cost = f"{named}{cost_text(problem, chosen.cost)}"
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
        f"{cost}; no rig of the grid costs less than {cost_text(problem, chosen.bound)}, a gap of "
        f"{100 * chosen.gap:.3g} %, when search.cheapest.seconds were over ({work})."
    )


def cost_text(problem: SearchProblem, cost: float) -> str:
    """Format a cost with its unit."""
    unit = _UNITS[problem.file.search.cheapest.by]
    return f"{cost:.6g} {unit.removesuffix('s') if cost == 1 else unit}".strip()


def print_answer(console: Console, answer: CheapestAnswer, folder: Path) -> None:
    """Print the rig, why it needs each LiDAR, and what binds; or the rig that lacks least."""
    console.print(answer.proof, style="bold", soft_wrap=True)
    if not answer.listed:
        console.print("No candidate keeps the constraints.")
    elif answer.rig is None:
        console.print("The closest rig that was checked:")
    elif answer.refined:
        console.print(answer.refined, soft_wrap=True)
    if answer.listed:
        head, rows = answer.lidar_rows()
        console.print(table("LiDARs", head, rows, words={"zone", WHY}))
    if answer.mirrored:
        console.print(pairs_sentence(answer.mirrored), soft_wrap=True)
    if len(answer.worst):
        binding = verdict_table(answer.worst, [])
        words = {binding.head[i] for i in binding.words}
        title = "What binds, least to spare first"
        console.print(table(title, binding.head, binding.rows, words=words))
    if answer.broken:
        console.print(f"broken: {', '.join(answer.broken)}")
    if answer.chosen.value is not None:
        objective = answer.problem.file.search.objective[0].name
        console.print(f"{objective}: {answer.chosen.value:.1f}")
    if answer.rig is not None:
        console.print(f"{folder / 'placement.yaml'}", soft_wrap=True)
    console.print(f"{folder / FILE}", soft_wrap=True)


def write_answer(answer: CheapestAnswer) -> Path:
    """Write the rig, if there is one, alone and with its vehicle, and `cheapest.json`.

    Returns their folder."""
    folder = answer.problem.folder / "cheapest"
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("placement.yaml", RIGS):
        (folder / name).unlink(missing_ok=True)
    content = json.dumps(as_json(answer), indent=1)
    write_text(folder / "cheapest.json", content)
    if answer.rig is not None:
        write_text(folder / "placement.yaml", answer.problem.placement_text(answer.rig))
    if answer.listed:
        write_text(folder / RIGS, answer.problem.rigs_text({answer.name: answer.listed}))
    return folder


def as_json(answer: CheapestAnswer) -> dict[str, object]:
    """Return the whole result for a script; infinite numbers are null."""
    problem, chosen, rig = answer.problem, answer.chosen, answer.rig
    check = answer.check if answer.listed else None
    cases = case_table(check.outcomes) if check is not None and check.outcomes else None
    numbers = {key: getattr(chosen, key) for key in ("cost", "bound", "fewest", "seconds", "value")}
    refined_cost = math.inf if rig is None else cost_of(rig, problem)
    numbers |= {**chosen.counts, "gap": chosen.gap, "refined_cost": refined_cost}
    return {
        "command": answer.command,
        "by": problem.file.search.cheapest.by,
        "found": rig is not None,
        **{k: None if v is None or not math.isfinite(v) else v for k, v in numbers.items()},
        "lidars": [asdict(lidar) for lidar in answer.listed],
        "without_it_fails": answer.needed_for if rig is not None else [],
        "mirrored": answer.mirrored,
        "margin": None if check is None or math.isinf(check.margin) else check.margin,
        "broken": [] if check is None else [c.name for c in check.broken],
        "cases": [] if cases is None else json.loads(cases.to_json(orient="records")),
    }
