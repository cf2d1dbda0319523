"""What a search prints: what it is about to do, and what it found."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from rich.console import Console

from lidarplace.command_line.terminal import table
from lidarplace.mounting.random_rigs import outside
from lidarplace.mounting.ring_overlap import interleaving
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, RAY_SURROGATES, SURROGATES
from sweeps.results.rig_cautions import beyond_what_is_seen, coinciding
from sweeps.search.greedy.certificate import why_none
from sweeps.search.judgement.winners import Found, Judged
from sweeps.search.output.tables import mount_columns
from sweeps.search.problem.choice import Choices, placement_of
from sweeps.search.problem.constraints import Constraint
from sweeps.search.problem.problem import Problem
from sweeps.search.problem.slots import rig_of
from sweeps.search.trials.by_detectors import class_weights
from sweeps.search.trials.study import finished_trials
from tracking.findings.evidence import ray_counting_caution
from tracking.run_folders.search import SearchFolder
from tracking.search_report.feasibility import infeasible_sentences, nothing_found
from tracking.search_report.headline import holds_zero

_TO_THE_LETTER = (
    "objective {name}: entropies are not negative, so every LiDAR lowers it, and it is highest for "
    "a placement that sees nothing; maximised to the letter of the paper it sends beams into the "
    "sky. expected_ig and covered_entropy reward what is seen."
)


_NOT_SUBMODULAR = (
    "objective {name}: is not submodular in the LiDARs. Greedy choice is that of what all of them "
    "find, without a guarantee; the bound is what one LiDAR less finds at most, or, where LiDARs "
    "come in mirrored pairs, what all of them find; refinement is of the objective itself."
)

_ONE_BY_ONE = (
    "objective {name}: greedy choice, refinement and bound put rigs together of LiDARs that were "
    "looked at one by one, and neglect that LiDARs hide each other by their size; {others}"
)
_TRIALS_KNOW = (
    "trials know it. So the bound holds, and the value of greedy choice may be above that of its "
    "rig as a trial."
)
_TRIALS_NEGLECT = "so do trials of this objective. Constraints and requirements know it."


def warnings_of(problem: Problem) -> list[str]:
    """What a user should know about this configuration."""
    contested = [
        _TO_THE_LETTER.format(name=objective.name)
        for objective in problem.file.search.objective
        if objective.by in SURROGATES
        and SURROGATES[objective.by].contested
        and objective.best == "maximize"
    ]
    begun_with = {name: rig_of(placed, problem.space) for name, placed in problem.start.items()}
    return contested + greedy_warnings(problem) + rig_warnings(begun_with, problem)


def greedy_warnings(problem: Problem) -> list[str]:
    """What greedy choice and its bound are where the objective is not submodular, and what they
    neglect."""
    first = problem.file.search.objective[0]
    if why_none(problem) is not None:
        return []
    said = [_NOT_SUBMODULAR.format(name=first.name)] if first.one_lidar_dead else []
    if _may_hide_each_other(problem):
        others = _TRIALS_KNOW if first.by in OBJECT_SURROGATES else _TRIALS_NEGLECT
        said.append(_ONE_BY_ONE.format(name=first.name, others=others))
    return said


def _may_hide_each_other(problem: Problem) -> bool:
    """Whether rigs have several LiDARs, and some of known size."""
    space = problem.space
    names = {*space.models, *(lidar.model for lidar in space.fixed)}
    sized = any(problem.models[name].size is not None for name in names)
    return sized and space.numbers[-1] + len(space.fixed) > 1


def rig_warnings(rigs: Mapping[str, Choices], problem: Problem) -> list[str]:
    """Of which of these rigs rings coincide, and which ones a generalist cannot know."""
    placements = {name: placement_of(rig, problem.models) for name, rig in rigs.items()}
    found = {name: interleaving(placement) for name, placement in placements.items()}
    said = [coinciding(name, better) for name, better in found.items() if better is not None]
    if not problem.judged:
        return said
    beyond = {name: outside(rig, problem.seen_rigs) for name, rig in placements.items()}
    return said + [beyond_what_is_seen(name, by) for name, by in beyond.items() if by is not None]


def print_problem(console: Console, problem: Problem) -> None:
    """The space, the objectives, the constraints and the sampler."""
    settings, space = problem.file.search, problem.space
    low, high = space.numbers
    wanted = ", ".join(f"{o.best} {o.name}" for o in settings.objective)
    sizes = {len(space.distributions(makeup) | space.further) for makeup in space.makeups}
    parameters = " to ".join(str(size) for size in sorted({min(sizes), max(sizes)}))
    if space.zones:
        number = f"{low} to {high}" if low < high else str(low)
        console.print(
            f"{problem.file.name}: {number} LiDARs in {', '.join(settings.zones)}, "
            f"{parameters} parameters; {wanted}"
        )
    else:
        console.print(
            f"{problem.file.name}: {problem.file.placement}, {parameters} parameters; {wanted}"
        )
    if over := settings.said_of(problem.traffic.search):
        console.print(f"judged by {over}")
    limits = ", ".join(describe(c) for c in problem.question.constraints) or "none"
    console.print(f"constraints: {limits}")
    console.print(
        f"{settings.trials} trials by {settings.sampler}, {settings.batch_size} at a time, "
        f"seed {settings.seed}"
    )
    if none := why_none(problem):
        console.print(f"no bound: {none}")
    for warning in warnings_of(problem):
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)


def planned(problem: Problem) -> dict[str, Any]:
    """What a search would do: what is varied, wanted and kept, and how it looks for it."""
    settings, space = problem.file.search, problem.space
    return {
        "name": problem.file.name,
        "lidars": list(space.numbers),
        "zones": list(settings.zones),
        "parameters": list(space.distributions(space.makeups[-1]) | space.further),
        "objectives": [{"name": o.name, "best": o.best} for o in settings.objective],
        "judged_on": [dict(changes) for changes in problem.tests.search] if problem.judged else [],
        "over": settings.over,
        "constraints": [asdict(constraint) for constraint in problem.question.constraints],
        "no_bound": why_none(problem),
        "trials": settings.trials,
        "sampler": settings.sampler,
        "batch_size": settings.batch_size,
        "seed": settings.seed,
        "warnings": warnings_of(problem),
    }


def describe(constraint: Constraint) -> str:
    """Such as "distance at least 0.2 m"."""
    sense = "at least" if constraint.at_least else "at most"
    return " ".join(
        filter(None, [constraint.name, sense, f"{constraint.limit:g}", constraint.unit])
    )


def print_nothing_found(console: Console, run: SearchFolder) -> None:
    """Which requirement or constraint no rig keeps, and by how much; or that no rig has a value."""
    console.print(nothing_found(run), style="bold", soft_wrap=True)
    for said in infeasible_sentences(run):
        console.print(f"  {said}", soft_wrap=True)


def print_failures(console: Console, found: Found) -> int:
    """Trials that failed, with the reason. Returns how many."""
    failed = [t for t in finished_trials(found.study) if "failure" in t.user_attrs]
    for trial in failed:
        text = f"trial {trial.number} failed: {trial.user_attrs['failure']}"
        console.print(text, soft_wrap=True)
    return len(failed)


def _print_rigs(console: Console, rigs: Mapping[str, Judged], problem: Problem) -> None:
    """Objectives and what constraints look at, a row a rig; a count is shown if one is not 0."""
    objectives = problem.file.search.objective
    constraints = [
        c
        for c in problem.question.constraints
        if c.limit or any(own.assessment.measures[c.name] for own in rigs.values())
    ]
    rows = []
    for name, own in rigs.items():
        found, values = own.assessment, own.all_values
        cells = [f"{values[o.name]:.6g}" if o.name in values else "" for o in objectives]
        cells += [
            f"{found.measures[c.name]:.3g}{' !' if found.violations[c.name] > 0 else ''}"
            for c in constraints
        ]
        rows.append((name, *cells))
    head = ("placement", *(o.name for o in objectives), *(c.name for c in constraints))
    console.print(table(problem.file.name, head, rows))


def _breaks(found: Found) -> str:
    """What is to be known of the baseline."""
    rig = found.judged[found.baseline]
    return "" if rig.assessment.feasible else ", which breaks a constraint"


def _print_chosen(console: Console, found: Found, problem: Problem) -> None:
    """What the choice says of the best rig, with its interval."""
    assert found.chosen is not None
    settings = problem.file.search
    objective, over = settings.objective[0], settings.said_of(problem.traffic.choice)
    over = f", {over}" if over else ""
    rows = found.chosen[found.chosen["rig"] == "found_1"]
    rows = rows[rows["metric"] == objective.by]
    for _, row in rows[rows["class"].isin(class_weights(objective, rows["class"]))].iterrows():
        console.print(
            f"{objective.by} @ {row['iou']:g}, {row['class']}, on other traffic{over}: "
            f"{row['value']:.1f}, {row['difference']:+.1f} "
            f"({row['difference_low']:+.1f} to {row['difference_high']:+.1f}) "
            f"against {found.baseline}, the best of the paper's eight{_breaks(found)}"
            f"{holds_zero(row['difference_low'], row['difference_high'])}",
            soft_wrap=True,
        )


def print_found(console: Console, problem: Problem, found: Found) -> None:
    """The best rigs beside greedy's and the paper's, and how far from the bound they are."""
    names = [*found.best[:3], *(name for name in found.judged if name not in found.best)]
    _print_rigs(console, {name: found.judged[name] for name in names}, problem)
    objective = problem.file.search.objective[0]
    if objective.judged:
        _print_chosen(console, found, problem)
    elif objective.of_traffic:
        best = found.judged["found_1"].value(objective)
        paper = found.judged[found.baseline].value(objective)
        if paper:
            gain = 100 * (best - paper) / abs(paper)
            console.print(
                f"{objective.name}: {gain:+.1f} % against {found.baseline}, "
                f"the best of the paper's eight{_breaks(found)}"
            )
    if found.certificate is not None and found.certificate.bound:
        value = found.judged["found_1"].searched[objective.name]
        gap = 100 * (1 - value / found.certificate.bound)
        stride = problem.question.azimuth_stride
        rays = f", with 1 of {stride} azimuth steps" if objective.by in RAY_SURROGATES else ""
        console.print(
            f"at most {gap:.1f} % below the best of {found.certificate.candidates:,} candidate "
            f"mounts{rays}"
            if gap >= 0
            else f"{-gap:.1f} % above what any choice of {found.certificate.candidates:,} "
            "candidate mounts can reach: positions between them are better"
        )
    elif found.no_certificate:
        console.print(f"no bound: {found.no_certificate}")
    mounts = [mount_columns(lidar) for lidar in found.judged["found_1"].rig]
    rows = [[f"{v:.3f}" if isinstance(v, float) else v for v in row.values()] for row in mounts]
    console.print(table("found_1, metres and degrees", list(mounts[0]), rows, words=("zone",)))
    for key, value in found.judged["found_1"].values_beside.items():
        console.print(f"{key}: {value}")
    caution = ray_counting_caution(found.linear_share or 0.0)
    shown = {name: found.judged[name].rig for name in ("found_1", found.baseline)}
    warned = rig_warnings(shown, problem)
    for text in [*([caution] if caution else []), *warned]:
        console.print(f"warning: {text}", style="yellow", soft_wrap=True)
