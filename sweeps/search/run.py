"""Run a search: POG, bound, trials, exact values of the winners, results, verification."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import optuna
import pandas as pd
from rich.console import Console

from lidarplace.base.errors import InputError
from lidarplace.command_line.verbs import wrong
from lidarplace.files.secret_urls import hide_secrets
from sweeps.execution.backends import Backend, BackendLost
from sweeps.execution.failures import Failure
from sweeps.execution.progress import StageProgress, about
from sweeps.execution.runner import Say, drive
from sweeps.mlflow.experiment import note
from sweeps.results.origin import record_origin
from sweeps.search.greedy.certificate import Certificate, first_params, kept_certificate, why_none
from sweeps.search.output.run_folder import write_search
from sweeps.search.output.tables import ABOUT, columns, ended_trials
from sweeps.search.output.terminal import print_failures, print_found
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.by_generalist import GeneralistAnswers
from sweeps.search.trials.study import Timing, emptied_journal, open_study, quiet, storage_in
from sweeps.search.trials.traffic import NoTraffic, Pool, SurrogateAnswers, training_traffic
from sweeps.search.verification.chosen import choose
from sweeps.search.verification.robustness import in_scene, robustness, with_share
from sweeps.search.verification.winners import (
    Found,
    Judged,
    baseline_of,
    best_trials,
    exact,
    judged,
)
from sweeps.stages.task import Task
from sweeps.store.local import Store
from sweeps.store.open import reference
from tracking.mlflow.content import ParentRun
from tracking.mlflow.experiment_page import source_tags
from tracking.mlflow.log import SweepLog
from tracking.run_folders.search import SearchFolder
from tracking.search_report.build import build_search_report

_ARTIFACTS = (".parquet", ".yaml", ".html", ".json")


def run_search(
    console: Console, problem: Problem, store: Store, command: str, verify: bool
) -> bool:
    """Search, write, verify. Returns whether all went well. Raises as `drive`."""
    work = SearchWork(console, problem, store, hide_secrets(command, *problem.file.urls))
    found, good = drive(console, problem.file, store, work)
    good &= not print_failures(console, found) and bool(found.trials)
    if verify and problem.file.verify is not None and found.trials:
        from sweeps.search.verification.verify import verify_found

        good &= verify_found(console, problem, found, work.command)
        build_search_report(problem.folder)
    console.print(f"{time.monotonic() - work.started:.0f} s")
    return good


class TrialProgress(StageProgress):
    """How many of the `wanted` trials are finished, and what their tasks do meanwhile: a bar in a
    terminal, elsewhere a line now and then."""

    def __init__(self, console: Console, wanted: int, store: Store) -> None:
        super().__init__(console, (), store)
        self._wanted, self._told = wanted, 0
        self._batch: tuple[float, int] | None = None  # seconds and trials of the latest
        self._since: float | None = None
        self._trials = self._bars.add_task("trials", total=wanted, now=self._running.__str__)

    def told(self, number: int) -> None:
        """So many trials are finished."""
        before, now = self._told, time.monotonic()
        # The first batch has what is done once, such as the training of a generalist.
        self._batch = None if self._since is None else (now - self._since, number - before)
        self._since, self._told = now, number
        self._bars.update(self._trials, completed=number)
        tenth, last = (10 * own // self._wanted for own in (number, before))
        if not self._console.is_terminal and tenth > last:
            self._console.print(f"trials {number}/{self._wanted}")

    def failed(self, task: Task, failure: Failure) -> None:
        """The trial has the reason."""
        self._running.ended(task)

    def now(self) -> str:
        """How many trials are finished, what runs, and when the last may be."""
        parts = [f"trials {self._told} of {self._wanted}"]
        if now := str(self._running):
            parts.append(f"now {now}")
        if self._batch is not None:
            seconds, trials = self._batch
            parts.append(f"about {about(seconds / trials * (self._wanted - self._told))} left")
        return "; ".join(parts)


@dataclass
class SearchWork:
    """The steps of a search; `command`, without passwords, makes it again."""

    console: Console
    problem: Problem
    store: Store
    command: str
    started: float = field(default_factory=time.monotonic)
    _storage: optuna.storages.BaseStorage = field(init=False)

    def open(self, folder: Path, say: Say) -> ParentRun:
        file, search = self.problem.file, self.problem.file.search
        record_origin(self.problem.sweep())
        self._storage = storage_in(folder)
        if (journal := emptied_journal(folder)) is not None:
            say(f"{journal} holds no trial, though this search had some: anew")
        params: dict[str, Any] = {"objective": ", ".join(own.name for own in search.objective)}
        params |= {key: getattr(search, key) for key in ("sampler", "seed", "batch_size")}
        return ParentRun(
            self.problem.key,
            file.name,
            params,
            tags=source_tags(),
            note=note(self.problem.source, self.command, file.urls),
            about=ABOUT,
            columns=columns(self.problem),
            ascending=search.objective[0].best == "minimize",
        )

    def compute(self, folder: Path, backend: Backend, log: SweepLog, say: Say) -> Found:
        """POG, bound, trials, exact values of the winners."""
        with quiet():
            try:
                return self._search(backend, log)
            except NoTraffic as error:
                raise BackendLost(f"no traffic: {error}") from None
            except InputError as error:  # of the configuration, or of a plug-in
                wrong(error)

    def report(self, folder: Path, found: Found, log: SweepLog) -> Path:
        """What was found, as tables, text, report and artifacts."""
        seconds = time.monotonic() - self.started
        write_search(folder, self.problem, found, self.command, seconds)
        run = SearchFolder.read(folder)
        print_found(self.console, self.problem, found, run)
        report = build_search_report(folder)
        for path in sorted(p for p in folder.iterdir() if p.suffix in _ARTIFACTS):
            log.artifact(path)
        return report

    def _search(self, backend: Backend, log: SweepLog) -> Found:
        problem = self.problem
        settings = problem.file.search
        traffic = training_traffic(self.console, problem, self.store, backend)
        # a cluster that cannot be joined is reported before the bound
        pool = Pool.of(backend, traffic)
        certificate, none = self._certificate(traffic)
        name = f"{reference(problem.sweep(), 'search')}-{problem.key}"
        study = open_study(self._storage, name, settings, first_params(problem, certificate))
        timing = self._trials(study, pool, backend, log)
        trials = best_trials(study, problem.space)
        rigs, chosen = judged(problem, trials, certificate, pool), None
        if problem.judged and trials:
            rigs, chosen = choose(self.console, problem, rigs, self.store, backend)
        robust = self._robustness(rigs, pool, backend, traffic) if trials else None
        return Found(study, trials, certificate, none, rigs, robust, traffic.grids, timing, chosen)

    def _certificate(self, traffic: Traffic) -> tuple[Certificate | None, str | None]:
        """Greedy choice and its bound; or None and why there is none."""
        problem, say = self.problem, self.console.print
        if (none := why_none(problem)) is not None:
            return None, none
        greedy = problem.file.search.greedy
        assert greedy is not None
        say(f"greedy choice, then its upper bound, up to {greedy.bound_seconds:g} s more …")
        found = kept_certificate(problem, traffic, problem.folder / "certificate.json")
        if found is None:
            return None, "no candidate mount keeps the constraints"
        say(
            f"greedy choice from {found.candidates:,} candidates: {found.value:.6g}; no choice "
            f"from them exceeds {found.bound:.6g} "
            f"({found.greedy_seconds:.0f} and {found.bound_seconds:.0f} s)"
        )
        if found.refined_value is not None:
            say(
                f"refined from {found.refined_from}, between the candidates: "
                f"{found.refined_value:.6g} ({found.refine_seconds:.0f} s)"
            )
        return found, None

    def _trials(self, study: optuna.Study, pool: Pool, backend: Backend, log: SweepLog) -> Timing:
        """Ask and tell; every trial is logged."""
        problem, settings = self.problem, self.problem.file.search
        progress = TrialProgress(self.console, settings.trials, self.store)
        answers = SurrogateAnswers(study, problem, pool)
        if problem.judged:
            answers = GeneralistAnswers(study, problem, pool, self.store, backend, progress)
        log.follow(partial(ended_trials, study, problem))
        with progress:
            return answers.run(progress.told)

    def _robustness(
        self, judged: Mapping[str, Judged], pool: Pool, backend: Backend, traffic: Traffic
    ) -> pd.DataFrame | None:
        """The best rigs with other mounts and in other scenes; None if it is not asked for."""
        problem, settings = self.problem, self.problem.file.robustness
        question = exact(problem.question)
        if settings is None or not traffic.grids:
            if settings is not None and "robustness" in problem.file.model_fields_set:
                self.console.print(
                    "robustness: not computed: no objective is a surrogate; the clouds of a "
                    "generalist have mounting_errors, and search.traffic may list other scenes",
                    soft_wrap=True,
                )
            return None
        rigs = {name: judged[name].rig for name in ("found_1", baseline_of(judged))}
        tables = [robustness(rigs, question, pool, settings, problem.file.search.seed)]
        for name, changes in settings.scenes.items():
            try:
                other = training_traffic(self.console, problem, self.store, backend, changes)
            except NoTraffic as error:  # what was found is worth more than one more scene
                self.console.print(f"robustness: {name} is left out: {error}", soft_wrap=True)
                continue
            tables.append(in_scene(rigs, question, Pool.of(backend, other), name))
        return with_share(pd.concat(tables, ignore_index=True))
