"""Run a search: POG, bound, trials, exact values of the winners, results, verification."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial

import optuna
import pandas as pd
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from lidarplace import OccupancyGrid
from lidarplace.command_line.verbs import wrong
from lidarplace.files.secret_urls import hide_secrets
from sweeps.configuration.file import ConfigError
from sweeps.execution.backends import Backend, BackendLost, backend_for
from sweeps.mlflow.page import note
from sweeps.search.greedy.certificate import Certificate, first_params, kept_certificate, why_none
from sweeps.search.judgement.found import Found, baseline_of, best_linear_share
from sweeps.search.judgement.robustness import in_scene, robustness, with_share
from sweeps.search.judgement.winners import Judged, best_trials, exact, judge, judge_others
from sweeps.search.output.mlflow_page import ABOUT, columns
from sweeps.search.output.mlflow_trials import ended_trials
from sweeps.search.output.run_folder import write_search
from sweeps.search.output.terminal import print_failures, print_found, print_nothing_found
from sweeps.search.problem.problem import Problem
from sweeps.search.problem.rig import Rig
from sweeps.search.trials.by_detectors import TrainingAnswers
from sweeps.search.trials.by_surrogates import SurrogateAnswers
from sweeps.search.trials.pog import NoPog, pog
from sweeps.search.trials.pool import Pool
from sweeps.search.trials.study import (
    Timing,
    is_emptied,
    journal_path,
    open_study,
    quiet,
    run_study,
    storage_for,
)
from sweeps.store.leftovers import remove_leftovers_of
from sweeps.store.lock import locked
from sweeps.store.of_sweep import reference, store_of
from sweeps.store.open import AnyStore
from tracking.mlflow.content import ParentRun
from tracking.mlflow.log import SweepLog
from tracking.mlflow.source import source_tags
from tracking.mlflow.uri import ui_command
from tracking.search_report.build import build_search_report


def run_search(console: Console, problem: Problem, command: str, verify: bool) -> bool:
    """Search, write the results, verify. Returns whether a placement was found and all went well.

    Raises:
        typer.Exit: another driver runs the search, or MLflow, Ray or a database cannot be had.
        BackendLost: Ray has gone.
        OSError: the run folder cannot be written.
    """
    start = time.monotonic()
    folder, file = problem.folder, problem.file
    say = partial(console.print, soft_wrap=True)
    command = hide_secrets(command, *file.urls)
    with ExitStack() as stack:
        workers = ExitStack()  # given back before the results are written
        try:
            store = store_of(problem.sweep())
            stack.enter_context(locked(folder, alone=True))
            remove_leftovers_of(file, store)
            stack.enter_context(store.in_use())
            storage = storage_for(file.search.storage, folder)
            if file.search.storage is None and is_emptied(folder):
                say(f"{journal_path(folder)} holds no trial, though this search had some: anew")
            log = stack.enter_context(_mlflow(problem, command, say))
            stack.enter_context(workers)
            backend = workers.enter_context(backend_for(file.ray))
        except ValueError as error:
            wrong(error)
        with workers, quiet():
            try:
                found = _search(console, problem, storage, store, backend, log)
            except NoPog as error:
                raise BackendLost(f"no POG: {error}") from None
            except ConfigError as error:
                wrong(error)
        write_search(folder, problem, found, command, time.monotonic() - start)
        if found.trials:
            print_found(console, problem, found)
        else:
            print_nothing_found(console, problem, found)
        report = build_search_report(folder)
        for path in sorted(p for p in folder.iterdir() if p.suffix in _ARTIFACTS):
            log.artifact(path)
        say(f"\nReport  {report}")
        say(f"MLflow  {ui_command(file.tracking_uri, log.page())}")
    failed = print_failures(console, found)
    good = bool(found.trials) and not failed and not log.undelivered and not log.refused
    if verify and file.verify is not None and found.trials:
        from sweeps.search.judgement.verify import verify_found

        good &= verify_found(console, problem, found, command)
        build_search_report(folder)
    console.print(f"{time.monotonic() - start:.0f} s", highlight=False)
    return good


_ARTIFACTS = (".parquet", ".yaml", ".html", ".json")


def _mlflow(problem: Problem, command: str, say: Callable[[str], None]) -> SweepLog:
    file, search = problem.file, problem.file.search
    params = {
        "objective": ", ".join(objective.name for objective in search.objective),
        "sampler": search.sampler,
        "seed": search.seed,
        "batch_size": search.batch_size,
    }
    parent = ParentRun(
        problem.key,
        file.name,
        params,
        tags=source_tags(),
        note=note(problem.source, command, file.urls),
        about=ABOUT,
        columns=columns(problem),
        ascending=search.objective[0].best == "minimize",
    )
    return SweepLog(file.tracking_uri, parent, folder=problem.folder, say=say)


def _search(
    console: Console,
    problem: Problem,
    storage: optuna.storages.BaseStorage,
    store: AnyStore,
    backend: Backend,
    log: SweepLog,
) -> Found:
    settings = problem.file.search
    grids: Mapping[str, OccupancyGrid] = {}
    if problem.question.needs_pog:
        grids = pog(console, problem, store, backend)
    certificate, none = None, why_none(problem)
    if none is None:
        certificate = _certificate(console, problem, grids)
        none = None if certificate else "no candidate mount keeps the constraints"
    first = first_params(problem, certificate)
    name = f"{reference(problem.sweep(), 'search')}-{problem.key}"
    study = open_study(storage, name, settings, first)
    timing = Timing()
    pool = Pool.of(backend, grids)
    if any(objective.measured for objective in settings.objective):
        answers: SurrogateAnswers | TrainingAnswers = TrainingAnswers(
            study, problem, pool, store, backend
        )
    else:
        answers = SurrogateAnswers(study, problem.space, problem.question, pool)
    log.follow(partial(ended_trials, study, problem))
    with _bar(console, settings.trials) as told:
        run_study(study, problem.space, settings, answers, told, timing)
    trials = best_trials(study, problem.space)
    judged = _judged(problem, trials, certificate, pool)
    table = None
    if trials and problem.file.robustness is not None and grids:
        table = robustness(
            _compared(judged),
            exact(problem.question),
            pool,
            problem.file.robustness,
            settings.seed,
        )
    if table is not None:
        table = with_share(_in_scenes(console, problem, judged, table, store, backend))
    share = best_linear_share(judged, grids, problem.question)
    return Found(study, trials, certificate, none, judged, table, grids, timing, share)


def _certificate(
    console: Console, problem: Problem, grids: Mapping[str, OccupancyGrid]
) -> Certificate | None:
    greedy = problem.file.search.greedy
    assert greedy is not None
    console.print(
        f"greedy choice, then its upper bound, up to {greedy.bound_seconds:g} s more …",
        highlight=False,
    )
    found = kept_certificate(problem, grids, problem.folder / "certificate.json")
    if found is None:
        return None
    console.print(
        f"greedy choice from {found.candidates:,} candidates: {found.value:.6g}; no choice from "
        f"them exceeds {found.bound:.6g} "
        f"({found.greedy_seconds:.0f} and {found.bound_seconds:.0f} s)",
        highlight=False,
    )
    if found.refined_value is not None:
        console.print(
            f"refined from {found.refined_from}, between the candidates: "
            f"{found.refined_value:.6g} ({found.refine_seconds:.0f} s)",
            highlight=False,
        )
    return found


def _judged(
    problem: Problem,
    trials: list[optuna.trial.FrozenTrial],
    certificate: Certificate | None,
    pool: Pool,
) -> dict[str, Judged]:
    """The best of the search, greedy's rigs and the paper's."""
    question = problem.question
    found = judge(trials, problem.space, question, pool)
    others = {}
    if certificate is not None and certificate.chosen:  # nothing, where no LiDAR sees anything
        others["greedy"] = certificate.rig
    if certificate is not None and certificate.refined is not None:
        others["refined"] = certificate.refined
    return (
        {f"found_{i}": own for i, own in enumerate(found, start=1)}
        | judge_others(others, "greedy", question, pool)
        | judge_others(problem.paper_rigs(), "paper", question, pool)
    )


def _compared(judged: Mapping[str, Judged]) -> dict[str, Rig]:
    """The rigs whose robustness is compared."""
    return {name: judged[name].rig for name in ("found_1", baseline_of(judged))}


def _in_scenes(
    console: Console,
    problem: Problem,
    judged: Mapping[str, Judged],
    table: pd.DataFrame,
    store: AnyStore,
    backend: Backend,
) -> pd.DataFrame:
    """`table`, and the same rigs in the other scenes."""
    settings = problem.file.robustness
    assert settings is not None
    rigs = _compared(judged)
    tables = [table]
    for name, changes in settings.scenes.items():
        try:
            grids = pog(console, problem, store, backend, changes)
        except NoPog as error:  # what was found is worth more than one more scene
            console.print(f"robustness: {name} is left out: {error}", soft_wrap=True)
            continue
        pool = Pool.of(backend, grids)
        tables.append(in_scene(rigs, exact(problem.question), pool, name))
    return pd.concat(tables, ignore_index=True)


@contextmanager
def _bar(console: Console, trials: int) -> Iterator[Callable[[int], None]]:
    """A bar of trials in a terminal; elsewhere a line now and then."""
    columns = (TextColumn("trials"), BarColumn(16), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("trials", total=trials)
        last = 0

        def told(number: int) -> None:
            nonlocal last
            progress.update(bar, completed=number)
            if not console.is_terminal and number * 10 // trials > last:
                last = number * 10 // trials
                console.print(f"trials {number}/{trials}", highlight=False)

        yield told
