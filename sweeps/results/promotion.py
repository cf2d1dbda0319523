"""Promotion: cheap values for all placements, full trainings for the best; the rungs of `promote`.

A rung waits for all its placements before it decides, so the outcome does not depend on which
machine was faster, nor on a stop in between."""

import itertools
import json
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from statistics import fmean

import pandas as pd

from lidarplace.base.metrics import OF_CLASSES, RANKING, Direction
from sweeps.configuration.grid import Sweep
from sweeps.configuration.sweep import Rung
from sweeps.plan.trial import Plan, Trial, with_detector
from sweeps.results.trial_results import headline_value, trial_seconds
from sweeps.stages.task import Task
from sweeps.store.local import Store
from tracking.run_folders.table_schema import Cell, cell

_ALL = "all"


@dataclass
class Promotion:
    """Progress of the placements of a sweep through the rungs.

    Attributes:
        pruned: by the trial's key, why it is not run.
        standings: rows of `table`.
        complete: whether all rungs have decided, so that the full trainings may run."""

    pruned: dict[str, str] = field(default_factory=dict)
    standings: list[dict[str, Cell]] = field(default_factory=list)
    complete: bool = False

    def table(self) -> pd.DataFrame:
        """Make a row per rung, group and placement.

        Columns rung, detector, the further axes, placement, by, class, value, rank (1 is best),
        kept, seconds (of this rung alone) and setting (what its trainings change)."""
        return pd.DataFrame(self.standings)


def promote(sweep: Sweep, plan: Plan, store: Store, run: Callable[[list[Task]], bool]) -> Promotion:
    """Go up the rungs of a sweep and, at last, through the full trainings.

    `run` runs the tasks a rung needs, as far as they have no result, and returns whether to
    continue."""

    def decide(number: int, rung: Rung, group: Mapping[str, list[Trial]]) -> dict[str, str | None]:
        rows, verdicts = _standings(number, rung, group, store)
        promotion.standings += rows
        return verdicts

    promotion = Promotion()
    promotion.complete = _climb(sweep, plan, run, decide, promotion.pruned)
    return promotion


def at_most(sweep: Sweep, plan: Plan) -> list[Task]:
    """List the tasks of a sweep if every rung keeps as many placements as it may."""
    tasks: dict[str, Task] = {}

    def note(needed: list[Task]) -> bool:
        tasks.update((task.key, task) for task in needed)
        return True

    def first_ones(number: int, rung: Rung, group: Mapping[str, list[Trial]]) -> dict[str, None]:
        return dict.fromkeys(list(group)[rung.keep :])

    _climb(sweep, plan, note, first_ones, {})
    return list(tasks.values())


def survivors(values: Mapping[str, float], keep: int, direction: Direction) -> set[str]:
    """Select the `keep` best names, and those that equal the last of them; none without a value."""
    finite = {name: value for name, value in values.items() if math.isfinite(value)}
    if len(finite) <= keep:
        return set(finite)
    sign = 1 if direction == "maximize" else -1
    least = sorted(sign * value for value in finite.values())[-keep]
    return {name for name, value in finite.items() if sign * value >= least}


def _climb(
    sweep: Sweep,
    plan: Plan,
    run: Callable[[list[Task]], bool],
    decide: Callable[[int, Rung, Mapping[str, list[Trial]]], Mapping[str, str | None]],
    pruned: dict[str, str],
) -> bool:
    """Run and decide rung by rung; return whether `run` continued to the end.

    Args:
        sweep: the sweep.
        plan: its plan.
        run: runs tasks, and returns whether to continue.
        decide: gets the trials of one group by placement; returns the placements that are out,
            with the reason, None if they are not pruned but have failed.
        pruned: takes up the reasons by the trial's key."""
    groups = _groups(plan.trials)
    rungs = sorted({trial.grid_point.rung for trial in plan.trials})
    out: set[str] = set()
    for number, rung in enumerate(sweep.common.promote):
        trained = next(r for r in rungs if r >= number)  # of a rung that trains nothing, the next
        contests = [_contest(trials, trained, out) for trials in groups]
        every = (
            trial for contest in contests for same_rig in contest.values() for trial in same_rig
        )
        ranked_by = (t.results if rung.by in RANKING else (t.pog, *t.scores) for t in every)
        if not run(plan.needed_for(itertools.chain.from_iterable(ranked_by))):
            return False
        for trials, contest in zip(groups, contests, strict=True):
            verdicts = decide(number, rung, contest)
            for trial in trials:
                name = trial.grid_point.point.placement
                if name in verdicts and trial.grid_point.rung > number and trial.key not in out:
                    out.add(trial.key)
                    if (reason := verdicts[name]) is not None:
                        pruned[trial.key] = reason
    last = (t for t in plan.trials if t.grid_point.rung == rungs[-1] and t.key not in out)
    return run(plan.needed_for(task for trial in last for task in trial.results))


def _groups(trials: Iterable[Trial]) -> list[list[Trial]]:
    """Group trials by detector and further axes: placements compete within one group."""
    groups: dict[str, list[Trial]] = {}
    for trial in trials:
        key = json.dumps([trial.grid_point.point.detector, _axes(trial)], sort_keys=True)
        groups.setdefault(key, []).append(trial)
    return list(groups.values())


def _contest(trials: Iterable[Trial], rung: int, out: Collection[str]) -> dict[str, list[Trial]]:
    contest: dict[str, list[Trial]] = {}
    for trial in trials:
        if trial.grid_point.rung == rung and trial.key not in out:
            contest.setdefault(trial.grid_point.point.placement, []).append(trial)
    return contest


def _axes(trial: Trial) -> dict[str, object]:
    fixed = ("placement", "detector", "seed", *trial.grid_point.set_by_rungs)
    return {axis: v for axis, v in trial.grid_point.axes.items() if axis not in fixed}


def _standings(
    number: int, rung: Rung, group: Mapping[str, list[Trial]], store: Store
) -> tuple[list[dict[str, Cell]], dict[str, str | None]]:
    """Make rows of `Promotion.table` of one group, and by placement the reason why it is out."""
    if not group:
        return [], {}
    point, axes = next(
        (t.grid_point.point, _axes(t)) for same_rig in group.values() for t in same_rig
    )
    object_class = rung.object_class or (point.classes[0] if rung.by in OF_CLASSES else _ALL)
    measured = {
        n: _value_and_seconds(trials, rung, object_class, store) for n, trials in group.items()
    }
    values = {name: value for name, (value, _) in measured.items()}
    survived = survivors(values, rung.keep, rung.best)
    ranks = pd.Series(values).rank(
        method="min", ascending=rung.best == "minimize", na_option="bottom"
    )
    rows: list[dict[str, Cell]] = [
        {
            "rung": number,
            "detector": point.detector_name or "",
            **{axis: cell(value) for axis, value in axes.items()},
            "placement": name,
            "by": rung.by,
            "class": object_class,
            "value": values[name],
            "rank": int(ranks[name]),
            "kept": name in survived,
            "seconds": seconds,
            "setting": ", ".join(f"{key}={value}" for key, value in rung.set.items()),
        }
        for name, (_, seconds) in measured.items()
    ]

    def reason(name: str) -> str | None:
        if math.isfinite(values[name]):
            place = f"rank {int(ranks[name])} of {len(group)}"
            return f"{place} by {rung.by} ({object_class}), {len(survived)} kept"
        return f"rung {number} has no {rung.by} of every seed" if rung.by in RANKING else None

    return rows, {name: reason(name) for name in group if name not in survived}


def _value_and_seconds(
    trials: Sequence[Trial], rung: Rung, object_class: str, store: Store
) -> tuple[float, float]:
    """Return what ranks a placement, a mean over seeds for a metric; NaN if nothing is there."""
    if rung.by in RANKING:
        whole = [trial for trial in with_detector(trials) if store.has(trial.evaluate)]
        seconds = math.fsum(trial_seconds(trial, store) for trial in whole)
        if len(whole) < len(trials):  # a mean over the other seeds would compare unlike things
            return math.nan, seconds
        tables = (store.read(trial.evaluate, attrgetter("metrics")) for trial in whole)
        return fmean(headline_value(rows, rung.by, object_class) for rows in tables), seconds
    task = trials[0].score_by(rung.by)
    if not store.has(task):
        return math.nan, math.nan
    table = store.read(task, attrgetter("table"))
    rows = table[table["surrogate"] == rung.by]
    if object_class != _ALL:
        rows = rows[rows["class"] == object_class]
    return math.fsum(rows["value"]), store.record(task).seconds
