"""Output of a search in the terminal: its plan, and its results."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from rich.console import Console

from lidarplace.command_line.terminal import print_warnings, table
from lidarplace.mounting.counts import CountBound
from lidarplace.mounting.random_rigs import outside
from lidarplace.mounting.ring_overlap import interleaving
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, SURROGATES
from lidarplace.rigs.scan_timing import STILL_WORLD
from sweeps.plan.plan import unused_sensor_warnings
from sweeps.results.rig_cautions import coinciding, facing, unfamiliar
from sweeps.search.greedy.certificate import why_none
from sweeps.search.output.tables import mount_columns
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig, placement_of
from sweeps.search.trials.study import finished_trials
from sweeps.search.verification.winners import AssessedRig, SearchFindings
from tracking.run_folders.search import SearchFolder
from tracking.search_report.cautions import cautions
from tracking.search_report.feasibility import amount, infeasible_sentences, nothing_found
from tracking.search_report.headline import answer, format_value, next_steps, pairs_sentence

_TO_THE_LETTER = (
    "objective {name}: entropies are not negative, so every LiDAR lowers it, and it is highest for "
    "a placement that sees nothing; maximised to the letter of the paper it sends beams into the "
    "sky. expected_ig and covered_entropy reward what is seen."
)
_ONE_BY_ONE = (
    "objective {name}: greedy choice, refinement and bound evaluate LiDARs one by one, and ignore "
    "that the housings of LiDARs hide objects from each other; {others}"
)
_TRIALS_KNOW = (
    "trials know it. So the bound holds, and the value of greedy choice may be above that of its "
    "rig as a trial."
)
_TRIALS_NEGLECT = "so do trials of this objective. Constraints and requirements know it."


def warnings_of(problem: SearchProblem) -> list[str]:
    """Return warnings about this configuration."""
    settings = problem.file.search
    contested = [
        _TO_THE_LETTER.format(name=o.name)
        for o in settings.objective
        if o.by in SURROGATES and SURROGATES[o.by].contested and o.best == "maximize"
    ]
    further = unused_sensor_warnings("each rig", settings.further_settings)
    warnings = [*contested, *problem.cautions, *further, *greedy_warnings(problem)]
    return warnings + rig_warnings(problem.start_rigs, problem)


def greedy_warnings(problem: SearchProblem) -> list[str]:
    """Return a warning if greedy choice and its bound neglect that LiDARs hide each other."""
    first, space = problem.file.search.objective[0], problem.space
    names = {*space.models, *(lidar.model for lidar in space.fixed)}
    sized = any(problem.models[name].size is not None for name in names)
    if why_none(problem) is not None or not sized or space.numbers[-1] + len(space.fixed) < 2:
        return []  # no LiDAR may hide another
    others = _TRIALS_KNOW if first.by in OBJECT_SURROGATES else _TRIALS_NEGLECT
    return [_ONE_BY_ONE.format(name=first.name, others=others)]


def rig_warnings(rigs: Mapping[str, Rig], problem: SearchProblem) -> list[str]:
    """Return warnings: coinciding rings, LiDARs that see each other, rigs new to the generalist."""
    placements = {name: placement_of(rig, problem.models) for name, rig in rigs.items()}
    vehicle = problem.criteria.carrier.vehicle
    warnings = [
        *coinciding({name: interleaving(placement) for name, placement in placements.items()}),
        *facing({name: (placement, vehicle) for name, placement in placements.items()}),
        *[STILL_WORLD] * any(model.timing for model in problem.models.values()),
    ]
    if problem.uses_generalist and not problem.pretrained:
        seen = problem.seen_rigs
        warnings += unfamiliar({name: outside(rig, seen) for name, rig in placements.items()})
    return warnings


def print_problem(console: Console, problem: SearchProblem) -> None:
    """Print the space, the objectives, the constraints and the sampler."""
    settings, space = problem.file.search, problem.space
    wanted = ", ".join(f"{o.best} {o.name}" for o in settings.objective)
    number, parameters = (
        " to ".join(map(str, sorted(set(span))))
        for span in (space.numbers, space.numbers_of_parameters)
    )
    console.print(
        f"{problem.file.name}: {number} LiDARs in {', '.join(settings.zones)}, "
        f"{parameters} parameters; {wanted}"
    )
    if counts := [*map(_count_text, space.bounds[:-1])]:
        console.print(f"counts: {', '.join(counts)}", soft_wrap=True)
    if pairs := [name for name, z in settings.zones.items() if z.mirrored or settings.symmetric]:
        console.print(pairs_sentence(pairs), soft_wrap=True)
    if over := settings.said_of(problem.traffic.search):
        console.print(f"evaluated by {over}")
    for zone in space.zones:
        if zone.z[1] < settings.zones[zone.name].z[1]:
            console.print(
                f"zone {zone.name}: z up to {zone.z[1]:g} m, as LiDARs are to be within its "
                f"standoff, {settings.zones[zone.name].standoff:g} m, above the body"
            )
    bounds = (f"{c.name} {c.sense} {c.limit:g} {c.unit}" for c in problem.criteria.constraints)
    console.print(f"constraints: {', '.join(map(str.rstrip, bounds)) or 'none'}")
    console.print(
        f"{settings.trials} trials by {settings.sampler}, {settings.batch_size} at a time, "
        f"seed {settings.seed}"
    )
    if none := why_none(problem):
        console.print(f"no bound: {none}")
    for warning in warnings_of(problem):
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)


def _count_text(bound: CountBound) -> str:
    numbers = " to ".join(map(str, dict.fromkeys((bound.low, bound.high))))
    return (
        f"{numbers} {'pairs ' * (bound.size > 1)}in {bound.zone}"
        if bound.zone
        else (f"{numbers} {bound.model}")
    )


def planned(problem: SearchProblem) -> dict[str, Any]:
    """Return the plan of a search: parameters, objectives, constraints and sampler."""
    settings, space = problem.file.search, problem.space
    return {
        "name": problem.file.name,
        "lidars": list(space.numbers),
        "zones": list(settings.zones),
        "counts": {bound.key: [bound.low, bound.high] for bound in space.bounds[:-1]},
        "parameters": list(space.distributions(space.all_counts[-1])),
        "objectives": [{"name": o.name, "best": o.best} for o in settings.objective],
        "judged_on": list(map(dict, problem.tests.search)) if problem.uses_generalist else [],
        "over": settings.over,
        "constraints": [asdict(constraint) for constraint in problem.criteria.constraints],
        "no_bound": why_none(problem),
        **settings.model_dump(include={"trials", "sampler", "batch_size", "seed"}),
        "warnings": warnings_of(problem),
    }


def print_failures(console: Console, findings: SearchFindings) -> int:
    """Print trials that failed, with the reason. Returns their number."""
    failed = [t for t in finished_trials(findings.study) if "failure" in t.user_attrs]
    for t in failed:
        console.print(f"trial {t.number} failed: {t.user_attrs['failure']}", soft_wrap=True)
    return len(failed)


def _print_rigs(
    console: Console, rigs: Mapping[str, AssessedRig], problem: SearchProblem, run: SearchFolder
) -> None:
    """Print objectives and measures of constraints, a row a rig; omit counts that are always 0."""
    objectives, rows = run.search.objectives, []
    limits = [
        c.name
        for c in problem.criteria.constraints
        if c.limit or any(assessed.assessment.measures[c.name] for assessed in rigs.values())
    ]
    for name, assessed in rigs.items():
        assessment, values = assessed.assessment, assessed.all_values
        cells = [format_value(o, values[o.name]) if o.name in values else "" for o in objectives]
        broken = {c: " !" if assessment.violations[c] > 0 else "" for c in limits}
        rows.append(
            (name, *cells, *(f"{amount(assessment.measures[c])}{broken[c]}" for c in limits))
        )
    head = ("placement", *(o.label for o in objectives), *limits)
    console.print(table(problem.file.name, head, rows))


def print_found(
    console: Console, problem: SearchProblem, findings: SearchFindings, run: SearchFolder
) -> None:
    """Print the best rigs, greedy's and the paper's, and the first lines of the report.

    Without a feasible rig: which requirement or constraint no rig keeps, and by how much, or that
    no rig has a value."""
    if not findings.trials:
        console.print(nothing_found(run), style="bold", soft_wrap=True)
        for sentence in infeasible_sentences(run):
            console.print(f"  {sentence}", soft_wrap=True)
        return
    names = [*findings.best[:3], *(name for name in findings.rigs if name not in findings.best)]
    _print_rigs(console, {name: findings.rigs[name] for name in names}, problem, run)
    mounts = [mount_columns(lidar) for lidar in findings.rigs["found_1"].rig]
    rows = [[f"{v:.3f}" if isinstance(v, float) else v for v in row.values()] for row in mounts]
    console.print(table("found_1, metres and degrees", list(mounts[0]), rows, words=("zone",)))
    print_warnings(console, cautions(run), "search.html")
    first = answer(run)
    for line in (f"{first.title}: {first.value}", *first.lines):
        console.print(line, soft_wrap=True)
    for step in next_steps(run)[:1]:
        console.print(f"{step.what[0].upper()}{step.what[1:]}: {step.line}", soft_wrap=True)
