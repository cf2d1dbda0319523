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
from sweeps.plan.pretrained import ON_GPU, uses_gpu
from sweeps.results.origin import record_origin
from sweeps.search.greedy.certificate import Certificate, first_params, kept_certificate, why_none
from sweeps.search.output.run_folder import write_search
from sweeps.search.output.tables import ABOUT, columns, ended_trials
from sweeps.search.output.terminal import print_failures, print_found
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.trials.by_generalist import GeneralistEvaluator
from sweeps.search.trials.study import Timing, emptied_journal, open_study, quiet, storage_in
from sweeps.search.trials.traffic import NoTraffic, Pool, SurrogateEvaluator, training_traffic
from sweeps.search.verification.reevaluation import reevaluate
from sweeps.search.verification.robustness import in_scene, robustness, with_share
from sweeps.search.verification.winners import (
    AssessedRig,
    SearchFindings,
    assess_best,
    baseline_of,
    best_trials,
    exact,
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
    console: Console, problem: SearchProblem, store: Store, command: str, verify: bool
) -> bool:
    """Search, write, verify. Returns whether all went well. Raises as `drive`."""
    work = SearchWork(console, problem, store, hide_secrets(command, *problem.file.urls))
    if problem.uses_generalist and uses_gpu(problem.file):
        console.print(ON_GPU)
    findings, good = drive(console, problem.file, store, work)
    good &= not print_failures(console, findings) and bool(findings.trials)
    if verify and problem.file.verify is not None and findings.trials:
        from sweeps.search.verification.verify import verify_found

        good &= verify_found(console, problem, findings, work.command)
        build_search_report(problem.folder)
    console.print(f"{time.monotonic() - work.started:.0f} s")
    return good


class TrialProgress(StageProgress):
    """Progress of `wanted` trials and their tasks: a bar in a terminal, elsewhere single lines."""

    def __init__(self, console: Console, wanted: int, store: Store) -> None:
        super().__init__(console, (), store)
        self._wanted, self._finished = wanted, 0
        self._batch: tuple[float, int] | None = None  # seconds and trials of the latest
        self._since: float | None = None
        self._trials = self._bars.add_task("trials", total=wanted, now=self._running.__str__)

    def count_finished(self, number: int) -> None:
        """Show that `number` trials are finished."""
        before, now = self._finished, time.monotonic()
        # The first batch has what is done once, such as the training of a generalist.
        self._batch = None if self._since is None else (now - self._since, number - before)
        self._since, self._finished = now, number
        self._bars.update(self._trials, completed=number)
        tenth, last = (10 * count // self._wanted for count in (number, before))
        if not self._console.is_terminal and tenth > last:
            self._console.print(f"trials {number}/{self._wanted}")

    def failed(self, task: Task, failure: Failure) -> None:
        """Ignore a failure of a task: its trial has the reason."""
        self._running.ended(task)

    def now(self) -> str:
        """Return the finished trials, the running tasks, and the estimated time left."""
        parts = [f"trials {self._finished} of {self._wanted}"]
        if now := str(self._running):
            parts.append(f"now {now}")
        if self._batch is not None:
            seconds, trials = self._batch
            parts.append(f"about {about(seconds / trials * (self._wanted - self._finished))} left")
        return "; ".join(parts)


@dataclass
class SearchWork:
    """The steps of a search; `command`, without passwords, runs it again."""

    console: Console
    problem: SearchProblem
    store: Store
    command: str
    started: float = field(default_factory=time.monotonic)
    _storage: optuna.storages.BaseStorage = field(init=False)

    def open(self, folder: Path, say: Say) -> ParentRun:
        """Open the journal; return the parent run."""
        file, search = self.problem.file, self.problem.file.search
        record_origin(self.problem.sweep())
        self._storage = storage_in(folder)
        if (journal := emptied_journal(folder)) is not None:
            say(f"{journal} holds no trial, though this search had some: anew")
        params: dict[str, Any] = {"objective": ", ".join(o.name for o in search.objective)}
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

    def compute(self, folder: Path, backend: Backend, log: SweepLog, say: Say) -> SearchFindings:
        """Compute POG, bound, trials and exact values of the winners."""
        with quiet():
            try:
                return self._search(backend, log)
            except NoTraffic as error:
                raise BackendLost(f"no traffic: {error}") from None
            except InputError as error:  # of the configuration, or of a plug-in
                wrong(error)

    def report(self, folder: Path, findings: SearchFindings, log: SweepLog) -> Path:
        """Write the results as tables, text, report and artifacts."""
        seconds = time.monotonic() - self.started
        write_search(folder, self.problem, findings, self.command, seconds)
        run = SearchFolder.read(folder)
        print_found(self.console, self.problem, findings, run)
        report = build_search_report(folder)
        for path in sorted(p for p in folder.iterdir() if p.suffix in _ARTIFACTS):
            log.artifact(path)
        return report

    def _search(self, backend: Backend, log: SweepLog) -> SearchFindings:
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
        assessed, chosen = assess_best(problem, trials, certificate, pool), None
        if problem.uses_generalist and trials:
            assessed, chosen = reevaluate(self.console, problem, assessed, self.store, backend)
        robust = self._robustness(assessed, pool, backend, traffic) if trials else None
        return SearchFindings(
            study, trials, certificate, none, assessed, robust, traffic.grids, timing, chosen
        )

    def _certificate(self, traffic: Traffic) -> tuple[Certificate | None, str | None]:
        """Return greedy choice and its bound; or None and why there is none."""
        problem, say = self.problem, self.console.print
        if (none := why_none(problem)) is not None:
            return None, none
        greedy = problem.file.search.greedy
        assert greedy is not None
        say(f"greedy choice, then its upper bound, up to {greedy.bound_seconds:g} s more …")
        certificate = kept_certificate(problem, traffic, problem.folder / "certificate.json")
        if certificate is None:
            return None, "no candidate mount keeps the constraints"
        say(
            f"greedy choice from {certificate.candidates:,} candidates: {certificate.value:.6g}; "
            f"no choice from them exceeds {certificate.bound:.6g} "
            f"({certificate.greedy_seconds:.0f} and {certificate.bound_seconds:.0f} s)"
        )
        if certificate.refined_value is not None:
            say(
                f"refined from {certificate.refined_from}, between the candidates: "
                f"{certificate.refined_value:.6g} ({certificate.refine_seconds:.0f} s)"
            )
        return certificate, None

    def _trials(self, study: optuna.Study, pool: Pool, backend: Backend, log: SweepLog) -> Timing:
        """Evaluate and log every trial."""
        problem, settings = self.problem, self.problem.file.search
        progress = TrialProgress(self.console, settings.trials, self.store)
        evaluator = SurrogateEvaluator(study, problem, pool)
        if problem.uses_generalist:
            evaluator = GeneralistEvaluator(study, problem, pool, self.store, backend, progress)
        log.follow(partial(ended_trials, study, problem))
        with progress:
            return evaluator.run(progress.count_finished)

    def _robustness(
        self, assessed: Mapping[str, AssessedRig], pool: Pool, backend: Backend, traffic: Traffic
    ) -> pd.DataFrame | None:
        """Assess the best rigs with other mounts and in other scenes, if that is configured."""
        problem, settings = self.problem, self.problem.file.robustness
        criteria = exact(problem.criteria)
        if settings is None or not traffic.grids:
            if settings is not None and "robustness" in problem.file.model_fields_set:
                self.console.print(
                    "robustness: not computed: no objective is a surrogate; the clouds of a "
                    "generalist have mounting_errors, and search.traffic may list other scenes",
                    soft_wrap=True,
                )
            return None
        rigs = {name: assessed[name].rig for name in ("found_1", baseline_of(assessed))}
        tables = [robustness(rigs, criteria, pool, settings, problem.file.search.seed)]
        for name, changes in settings.scenes.items():
            try:
                other = training_traffic(self.console, problem, self.store, backend, changes)
            except NoTraffic as error:  # what was found is worth more than one more scene
                self.console.print(f"robustness: {name} is left out: {error}", soft_wrap=True)
                continue
            tables.append(in_scene(rigs, criteria, Pool.of(backend, other), name))
        return with_share(pd.concat(tables, ignore_index=True))
