"""Objects that one rig finds and another one misses: `lidarplace failures runs/grid`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lidarplace.base.errors import InputError
from lidarplace.command_line.invocation import command
from lidarplace.command_line.terminal import output, say
from lidarplace.command_line.verbs import checked_input, new_app, verb
from lidarplace.configuration.renamed_keys import current_key

if TYPE_CHECKING:
    from tracking.findings.failures import Failures
    from tracking.findings.groups import Group
    from tracking.run_folders.arrays import FailureFrames
    from tracking.run_folders.sweep import RunFolder

app = new_app()


@verb(app, "runs/grid", "runs/grid --rigs center,line --out compared")
def failures(
    run: Annotated[Path, typer.Argument(help="folder of a sweep, runs/NAME")],
    rigs: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME",
            help="two placements; by default the one that the sweep recommends and the next one",
        ),
    ] = None,
    where: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="detector or value of a further axis, such as evaluator=generalist; repeatable",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="folder of the page and the tables")
    ] = Path("failures"),
) -> None:
    """Count the objects that only one of two rigs finds, and show the frames that differ most.

    Trains and detects nothing. Writes OUT/failures.html, OUT/tables/failures.csv with the counts
    and OUT/objects.parquet and .csv with the result of each object. The frames need the
    configuration of the sweep in RUN and its results in the store."""
    from lidarplace.files.atomic import replacing
    from lidarplace.files.tables import write_csv
    from tracking.pages.html_page import FOLDER, write_csv_files
    from tracking.report.failures import write_failures
    from tracking.report.sections.failures import FILE, counted_failures
    from tracking.run_folders.sweep import RunFolder

    with checked_input():
        folder = RunFolder.read(run)
        compared = _compared(folder, rigs, where or [])
        frames, lacking = _frames(folder, compared)
        section = counted_failures(compared)
        out.mkdir(parents=True, exist_ok=True)
        write_csv_files(out / FOLDER, [section])
        table = compared.table()
        with replacing(out / "objects.parquet") as partial:
            table.to_parquet(partial, index=False)
        write_csv(table, out / "objects.csv")
        extent = f"{folder.sweep.name}: {folder.sweep.frames.test:,} test frames."
        page = write_failures(out / FILE, folder, compared, frames, section, extent, {})
    for sentence in section.notes[:2]:
        output().print(sentence, soft_wrap=True)
    if lacking:
        say(f"no frames are shown: {lacking}")
    say(str(page))


def _compared(run: RunFolder, rigs: str | None, where: list[str]) -> Failures:
    from tracking.findings.failures import failures
    from tracking.findings.groups import copies, groups, without
    from tracking.findings.promotion import fully_trained
    from tracking.report.recommendation import Recommendation, compared_failures

    for name in ("objects", "found"):
        if getattr(run, name) is None:
            problem = "missing, as the sweep ran before there was any"
            fix = f"its command writes it, from what is in the store: {run.sweep.command}"
            raise InputError(problem, place=run.path / f"{name}.parquet", fix=fix)
    run = fully_trained(run if rigs else without(run, set(copies(run))))
    every = [group for group in groups(run) if group.detector]
    chosen = [group for group in every if _holds(group, where)]
    if not chosen:
        places = "; ".join(
            ", ".join(f"{key}={value}" for key, value in group.place.items()) for group in every
        )
        problem = f"{run.path} has {places or 'no detector'}"
        raise InputError(problem, place=f"--where {' '.join(where)}")
    if rigs is None:
        ranked = [Recommendation(run, group) for group in chosen]
        comparison = compared_failures([one for one in ranked if one.ranking])
        named = "two rigs"
    else:
        first, second = _two(rigs, run)
        both = (failures(run, group, (first, second)) for group in chosen)
        comparison = next((result for result in both if result is not None), None)
        named = f"both {first} and {second}"
    if comparison is None:
        raise InputError(f"no detector of one seed was tested under {named}", place=run.path)
    return comparison


def _two(rigs: str, run: RunFolder) -> tuple[str, str]:
    names = rigs.split(",")
    if len(names) != 2 or names[0] == names[1]:
        raise InputError(place=f"--rigs {rigs}", expected="two placements, such as center,line")
    for name in names:
        if name not in run.placements:
            problem, placements = f"{run.path} has no placement {name}", ", ".join(run.placements)
            raise InputError(problem, place="--rigs", expected=placements)
    return names[0], names[1]


def _holds(group: Group, where: list[str]) -> bool:
    place = {key: str(value) for key, value in group.place.items()}
    return all(
        place.get(current_key(key)) == value
        for key, _, value in (pair.partition("=") for pair in where)
    )


def _frames(run: RunFolder, compared: Failures) -> tuple[FailureFrames | None, str]:
    """Return the frames of the rigs, or why there are none."""
    from sweeps.plan.plan import read_plan
    from sweeps.plan.trial import with_detector
    from sweeps.results.failure_frames import failure_frames
    from sweeps.results.trial_results import identity
    from sweeps.store.open import store_of

    if run.sweep.detections:
        stored = run.failures
        if stored is None or not stored.are_of(compared.rigs, compared.objects["object"]):
            return None, "`lidarplace evaluate` keeps those of the recommended rigs alone"
        return stored, ""
    config = run.path / "config.yaml"
    sweep, plan = read_plan(config, [])
    store = store_of(sweep)
    # Not by their keys, in which surrogates count.
    place = ["placement", "detector", "seed", *run.axes]
    wanted = run.trials.set_index("trial")[place].loc[list(compared.trials)]
    by_place = {
        tuple(identity(t, run.axes)[key] for key in place): t for t in with_detector(plan.trials)
    }
    rows = zip(wanted.index, wanted.itertuples(index=False, name=None), strict=True)
    trials = {str(key): by_place[row] for key, row in rows if row in by_place}
    tasks = ((trial.evaluate, *trial.collect_test) for trial in trials.values())
    needed = {task.key: task for of_trial in tasks for task in of_trial}
    recorded = set() if run.tasks is None else set(run.tasks.get("key", ()))
    available = recorded & store.finished(needed.values())
    if len(trials) < len(compared.trials) or not available.issuperset(needed):
        return None, (
            f"the store of {config} has no clouds and detections of {' and '.join(compared.rigs)} "
            f"by this code; {command('run', str(config))} makes them"
        )
    return failure_frames(compared, trials, store), ""
