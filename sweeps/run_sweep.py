"""Run of a sweep: its tasks, results, MLflow and the report."""

import hashlib
import json
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from rich.console import Console

from lidarplace.command_line.invocation import command
from lidarplace.command_line.terminal import print_warnings, table
from lidarplace.command_line.verbs import wrong
from sweeps.configuration.grid import Sweep
from sweeps.execution.backends import Backend
from sweeps.execution.execute import Outcome, execute
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.runner import Say, drive
from sweeps.mlflow.experiment import ABOUT, chart, columns, headline_column, note
from sweeps.mlflow.trials import TrialLog
from sweeps.plan.pretrained import ON_GPU, uses_gpu
from sweeps.plan.trial import Plan, Trial
from sweeps.results.failure_frames import write_failure_frames
from sweeps.results.origin import record_origin
from sweeps.results.promotion import promote
from sweeps.results.run_folder import Run, write_run
from sweeps.results.trial_results import trial_failure
from sweeps.stages.task import Task
from sweeps.store.cleaning import clean_store
from sweeps.store.local import Store
from sweeps.store.open import reference
from tracking.findings.evidence import largest_linear_share, ray_counting_caution
from tracking.findings.summary import summary_table
from tracking.mlflow.content import ParentRun
from tracking.mlflow.experiment_page import source_tags
from tracking.mlflow.log import SweepLog
from tracking.report.analysis import Analysis
from tracking.report.build import write_report
from tracking.report.decision.build import FILE as DECISION


def run_sweep(
    console: Console, sweep: Sweep, plan: Plan, store: Store, command: str, rerun_failed: bool
) -> bool:
    """Run the plan, log it, report it; return whether all trials finished and were logged.

    `command` makes the sweep again, `rerun_failed` retries failures by data or settings, too.
    Raises as `sweeps.execution.runner.drive`."""
    for typical in plan.typical:
        console.print(f"anchors of {typical}", soft_wrap=True)
    if plan.networks and uses_gpu(sweep.common):
        console.print(ON_GPU)
    for caution in plan.cautions:
        console.print(f"warning: {caution}", style="yellow", soft_wrap=True)
    work = SweepWork(console, sweep, plan, store, command, rerun_failed)
    run, logged = drive(console, sweep.common, store, work)
    took = f"{time.monotonic() - work.started:.0f} s"
    decision = sweep.common.output / sweep.common.name / DECISION
    console.print(f"Decision  {decision}  ({took})" if decision.exists() else took, soft_wrap=True)
    failed = _failed(plan, run)
    for trial, failure in failed:
        console.print(f"failed: {trial.label}: {failure.reason}", soft_wrap=True)
    if failed:
        folder = sweep.common.output / sweep.common.name / "failed"
        summary = f"{len(failed)} of {len(plan.trials)} trials failed; see {folder}. "
        console.print(f"{summary}--rerun-failed tries all of them again.")
    for line in work.answer:
        console.print(line, soft_wrap=True)
    return logged and not failed


@dataclass(frozen=True)
class SweepWork:
    """Steps of a sweep, started on the clock of `Outcome.times`."""

    console: Console
    sweep: Sweep
    plan: Plan
    store: Store
    command: str
    rerun_failed: bool
    started: float = field(default_factory=time.monotonic)
    answer: list[str] = field(default_factory=list)

    def open(self, folder: Path, say: Say) -> ParentRun:
        """Refer to the results, make room for more of them."""
        sweep, plan = self.sweep, self.plan
        record_origin(sweep)
        self.store.refer(reference(sweep), [task.key for task in plan.tasks])
        keep_to_quota(self.console, sweep, self.store)
        parameters = {
            "placements": len({trial.grid_point.point.placement for trial in plan.trials}),
            "trials": len(plan.trials),
            "axes": ", ".join(sorted(sweep.axes)),
        }
        return ParentRun(
            sweep_key(sweep, plan),
            sweep.common.name,
            parameters,
            tags=source_tags(),
            note=note(sweep.source, self.command, sweep.common.urls),
            about=ABOUT,
            columns=columns(sweep),
            order_by=headline_column(sweep),
            chart=chart(sweep),
        )

    def compute(self, folder: Path, backend: Backend, log: SweepLog, say: Say) -> Run:
        """Run tasks without a result that have not failed for good, rung by rung."""
        sweep, plan, store = self.sweep, self.plan, self.store
        store.end_running(plan.tasks)  # what a killed driver left
        cached = store.finished(plan.tasks)
        failures = FailureFolder(folder / "failed")
        try:
            lasting_failures = failures.lasting(self.rerun_failed, cached)
        except ValueError as error:
            wrong(error)
        outcome = Outcome()
        pictures = folder / "pictures"
        listener = TrialLog(self.console, sweep, plan, store, failures, cached, pictures)
        with listener:
            log.follow(listener.ended)

            def run_tasks(tasks: list[Task]) -> bool:
                execute(tasks, store, backend, listener, outcome, lasting_failures)
                return True

            promotion = promote(sweep, plan, store, run_tasks)
            cores = backend.cores if outcome.times else None
        listener.end(outcome.failures)
        log.hold()
        seconds = time.monotonic() - self.started
        return Run(outcome, promotion, cached, cores, self.command, self.started, seconds)

    def report(self, folder: Path, run: Run, log: SweepLog) -> Path | None:
        """Write the tables; and report, artifacts and summary, if a trial finished."""
        analysis = write_run(folder, self.sweep, self.plan, self.store, run)
        frames = write_failure_frames(analysis, self.plan, self.store)
        if len(_failed(self.plan, run)) == len(self.plan.trials):
            return None
        report = write_report(analysis, frames)
        pages = (*sorted(folder.glob("*.html")), report.with_suffix(".md"))
        written = (*pages, folder / "sweep.json", folder / "config.yaml")
        for path in (*written, *sorted(folder.glob("*.parquet"))):
            log.artifact(path)
        for path in (*(folder / "tables").glob("*.csv"), *(folder / "figures").glob("*.png")):
            log.artifact(path, path.parent.name)
        _print_summary(self.console, analysis)
        self.answer.extend(analysis.headline)
        return report


def _failed(plan: Plan, run: Run) -> list[tuple[Trial, Failure]]:
    """List trials that failed, and why; without those that were pruned."""
    pruned, failures = run.promotion.pruned, run.outcome.failures
    run_on = (trial for trial in plan.trials if trial.key not in pruned)
    return [(trial, failure) for trial in run_on if (failure := trial_failure(trial, failures))]


def keep_to_quota(console: Console, sweep: Sweep, store: Store) -> None:
    """Remove results that no sweep refers to, oldest first, beyond the quota of the store."""
    quota_gb = sweep.common.store.quota_gb
    if quota_gb is None:
        return
    try:
        with store.exclusive():
            cleaned = clean_store(store, int(quota_gb * 1e9))
    except ValueError as error:
        console.print(f"store: not cleaned: {error}", soft_wrap=True)
        return
    if cleaned.kept_bytes > quota_gb * 1e9:
        console.print(
            f"store: {cleaned.kept_bytes / 1e9:.3g} GB belong to sweeps, more than quota_gb "
            f"{quota_gb:g}; {command('clean')} lists their names, and --forget NAME gives "
            "one up"
        )


def sweep_key(sweep: Sweep, plan: Plan) -> str:
    """Identify a sweep among others of its name, by its trials, axes and rungs."""
    rungs = [rung.model_dump(mode="json") for rung in sweep.common.promote]
    keys = sorted(trial.key for trial in plan.trials)
    content = json.dumps([keys, rungs, sorted(sweep.axes)])
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def _print_summary(console: Console, analysis: Analysis) -> None:
    run = analysis.complete
    summary = summary_table(run)
    alone = run.results.empty
    unit = "entropies in nats" if alone else "means over seeds, percent"
    cell = partial(_short, form=".4g" if alone else ".1f")
    rows = (map(cell, row) for row in summary.itertuples(index=False))
    title = f"{run.path.name}: best placement first, {unit}"
    console.print(table(title, list(summary.columns), rows))
    counted = ray_counting_caution(largest_linear_share(run.surrogates))
    print_warnings(console, [*counted, *run.sweep.cautions], "report.html")


def _short(value: object, form: str) -> str:
    """Format a number in six places or less: 62.3, -134k, 7.69k; `form` is used below 1,000."""
    if not isinstance(value, float):
        return str(value)
    return f"{value / 1000:.3g}k" if abs(value) >= 1000 else f"{value:{form}}"
