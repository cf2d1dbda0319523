"""Runs of one sweep at MLflow: found again by tags, and completed, so that none is doubled."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidarplace.base.errors import InputError
from lidarplace.files.secret_urls import hide_secrets, public_url
from tracking.mlflow.connection import (
    Away,
    connect,
    is_away,
    is_busy,
    is_forbidden,
    is_server_error,
    reason,
)
from tracking.mlflow.content import Dataset, EndedTrial, ParentRun, TrialRun
from tracking.mlflow.experiment_page import NOTE_TAG, VIEW_TAG, page_of, view
from tracking.mlflow.uri import is_server, sqlite_file

if TYPE_CHECKING:
    from mlflow.entities import Run

SWEEP_TAG = "lidarplace.sweep"
TRIAL_TAG = "lidarplace.trial"
ERROR_TAG = "lidarplace.error"
REFUSED_TAG = "lidarplace.refused"  # what MLflow did not take of a run, which is tried again
PARENT_TAG = "mlflow.parentRunId"
_LONGEST_REASON = 5000  # characters of a tag


class SweepRuns:
    """Parent run and child runs of a sweep.

    A trial's run ends last of all, so one that has ended has everything, and any other is
    completed: what is there of it is not logged again. So everything may be written again.

    All methods that write raise Away when it may or may not be written, after which `open` finds
    out, and anything else for what MLflow does not take. `uri` is absolute; a new experiment
    keeps its files in `artifacts` if MLflow writes to a database itself."""

    def __init__(self, uri: str, parent: ParentRun, artifacts: Path) -> None:
        self._uri = uri
        self._wanted = parent
        self._artifacts = artifacts
        self._client: Any = None
        self._experiment = ""
        self._parent: Any = None
        self._trials: dict[str, Run] = {}
        self._whole: dict[str, str | None] = {}
        """By the trial's key, why it failed."""
        self._monitor: Any = None

    @property
    def is_open(self) -> bool:
        """Whether there is a connection, as far as is known."""
        return self._client is not None

    def open(self) -> None:
        """Find, or make, the experiment and the parent run, which is RUNNING; find the trials.

        Raises ValueError: the server cannot take this sweep, or a local database cannot be
        opened; Away: there is no connection now."""
        try:
            self._client = connect(self._uri)
            self._experiment = self._find_experiment()
            runs = self._find_runs()
            self._trials = self._one_each([r for r in runs if TRIAL_TAG in r.data.tags])
            self._whole = {key: _error(r) for key, r in self._trials.items() if _is_whole(r)}
            self._parent = self._one_parent([r for r in runs if TRIAL_TAG not in r.data.tags])
            self._describe()
            self._watch_machine()
        except Exception as error:
            self._client = None
            if isinstance(error, ValueError):
                raise
            local = sqlite_file(self._uri) is not None
            may_return = is_busy(error) if local else not is_forbidden(error)
            if may_return and is_away(error, self._uri):
                raise Away(reason(error)) from error
            raise InputError(reason(error, self._uri), place=public_url(self._uri)) from error

    def lacks(self, trial: EndedTrial) -> bool:
        """Tell whether something of a trial is missing; one that is finished never fails again."""
        is_logged = trial.key in self._whole
        return not is_logged or self._whole[trial.key] not in (None, _short(trial.error))

    def write_trial(self, trial: EndedTrial, content: TrialRun) -> None:
        """Make the run of a trial, or complete it, and end it.

        What MLflow does not take is recorded in a tag: the run has FAILED without its values,
        and is FINISHED without its files."""
        with self._connected():
            if (run := self._trials.get(trial.key)) is not None:
                run = self._client.get_run(run.info.run_id)
            else:
                run = self._trials[trial.key] = self._create_trial(trial, content)
            status, refused = self._fill(run, trial, content)
            if refused is not None:
                why = hide_secrets(reason(refused), self._uri)
                self._client.set_tag(run.info.run_id, REFUSED_TAG, _short(why))
            elif REFUSED_TAG in run.data.tags:
                self._client.delete_tag(run.info.run_id, REFUSED_TAG)
            ends = run.info.start_time + round(1000 * content.metrics.get("seconds", 0.0))
            self._client.set_terminated(run.info.run_id, status, ends)
        if refused is not None:
            raise refused
        self._whole[trial.key] = _short(trial.error)

    def write_file(self, path: Path, folder: str | None) -> None:
        """Copy a file to the artifacts of the parent run, into `folder` of them."""
        with self._connected(files=True):
            if not path.is_file():
                raise InputError("no such file", place=path)
            self._client.log_artifact(self._parent.info.run_id, str(path), folder)

    def end(self, status: str) -> None:
        """End the parent run with one of MLflow's statuses."""
        with self._connected():
            self._monitor.finish()
            self._client.set_terminated(self._parent.info.run_id, status)

    def page(self) -> str:
        """Return the experiment's page below the server's address; "" before `open` succeeded."""
        return page_of(self._experiment, bool(self._wanted.columns)) if self._experiment else ""

    @contextmanager
    def _connected(self, files: bool = False) -> Iterator[None]:
        """Raise Away, and close the connection, where the block may succeed later.

        A server's answer 500 is a refusal where it writes `files`."""
        try:
            yield
        except Away:
            raise
        except Exception as error:
            if not is_away(error, self._uri) or (files and is_server_error(error)):
                raise
            self._client = None
            raise Away(reason(error)) from error

    def _watch_machine(self) -> None:
        """Let MLflow's monitor log system metrics of the parent run.

        Its thread ends where MLflow is away: each connection gets a new one, which goes on."""
        from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor

        if self._monitor is not None:
            self._monitor.finish()
        run_id = self._parent.info.run_id
        self._monitor = SystemMetricsMonitor(run_id, resume_logging=True, tracking_uri=self._uri)
        self._monitor.start()

    def _find_experiment(self) -> str:
        name = self._wanted.name
        experiment = self._client.get_experiment_by_name(name)
        if experiment is None:
            place = None if is_server(self._uri) else self._artifacts.resolve().as_uri()
            # The kind decides which of its two faces the UI shows: this is model training.
            tags = {"mlflow.experimentKind": "custom_model_development"}
            return str(self._client.create_experiment(name, place, tags))
        if experiment.lifecycle_stage != "active":
            fix = "restore it, or give the sweep another name"
            raise InputError("deleted in MLflow", place=f"experiment {name!r}", fix=fix)
        return str(experiment.experiment_id)

    def _find_runs(self) -> list[Any]:
        """Find all runs of this sweep, the parent among them, oldest first."""
        query = {"filter_string": f"tags.`{SWEEP_TAG}` = '{self._wanted.key}'", "max_results": 1000}
        query["order_by"] = ["attributes.start_time ASC"]
        page = self._client.search_runs([self._experiment], **query)
        runs = list(page)
        while page.token:
            query["page_token"] = page.token
            page = self._client.search_runs([self._experiment], **query)
            runs += page
        return runs

    def _one_each(self, runs: list[Run]) -> dict[str, Run]:
        """Keep one run of each trial: a server that answered late may have made a second one."""
        trials: dict[str, Run] = {}
        for run in sorted(runs, key=lambda run: run.info.status != "FINISHED"):
            if run is not trials.setdefault(run.data.tags[TRIAL_TAG], run):
                self._client.delete_run(run.info.run_id)
        return trials

    def _one_parent(self, parents: list[Any]) -> Any:
        """Keep the oldest parent run, for the same reason; all trials become its children."""
        parent, *others = parents or [self._create(self._wanted.name, {}, None)]
        for run in others:
            self._client.delete_run(run.info.run_id)
        for run in self._trials.values():
            if run.data.tags.get(PARENT_TAG) != parent.info.run_id:
                self._client.set_tag(run.info.run_id, PARENT_TAG, parent.info.run_id)
        return parent

    def _create(self, name: str, tags: Mapping[str, str], time: int | None) -> Any:
        tags = {SWEEP_TAG: self._wanted.key, **self._wanted.tags, **tags}
        return self._client.create_run(self._experiment, time, tags, name)

    def _create_trial(self, trial: EndedTrial, content: TrialRun) -> Any:
        """Make a run with the tags that find it again; its start follows from its seconds."""
        names = {TRIAL_TAG: trial.key, PARENT_TAG: self._parent.info.run_id}
        tags = _tags_of(trial, content) | names
        began = content.ended - round(1000 * content.metrics.get("seconds", 0.0))
        return self._create(content.name, tags, began)

    def _fill(self, run: Any, trial: EndedTrial, content: TrialRun) -> tuple[str, Exception | None]:
        """Log what a run has not got; return its status, and why MLflow does not take all."""
        status = "FAILED"
        try:
            with self._connected():
                self._log_values(run, trial, content)
            status = "FINISHED" if trial.error is None else "FAILED"
            with self._connected(files=True):
                for path in content.files:
                    self._client.log_artifact(run.info.run_id, str(path))
        except Away:
            raise
        except Exception as error:
            return status, error
        return status, None

    def _log_values(self, run: Any, trial: EndedTrial, content: TrialRun) -> None:
        """Log parameters, metrics, tags and data that a run has not got."""
        from mlflow.entities import Metric, Param, RunTag

        run_id, logged = run.info.run_id, self._points_of(run)
        if trial.error is None and ERROR_TAG in run.data.tags:
            self._client.delete_tag(run_id, ERROR_TAG)
        metrics = [
            Metric(name, value, run.info.start_time, step)
            for name, step, value in content.points()
            if (name, step) not in logged
        ]
        params = _new(_texts(content.params), run.data.params)
        tags = _new(_tags_of(trial, content), run.data.tags)
        self._client.log_batch(run_id, metrics, _each(Param, params), _each(RunTag, tags))
        if content.datasets:
            self._client.log_inputs(run_id, [_input(dataset) for dataset in content.datasets])

    def _points_of(self, run: Any) -> set[tuple[str, int]]:
        """Find (metric, step) of all that was logged."""
        return {
            (name, point.step)
            for name in run.data.metrics
            for point in self._client.get_metric_history(run.info.run_id, name)
        }

    def _describe(self) -> None:
        """Write parameters, tags and status of the parent run, and the experiment's page."""
        from mlflow.entities import Param, RunTag

        wanted, run = self._wanted, self._client.get_run(self._parent.info.run_id)
        params = _texts(wanted.params)
        for name, value in run.data.params.items():
            if params.get(name, value) != value:
                fault, fix = "changed since the sweep began", "give the sweep another name"
                place, now = f"run {run.info.run_name!r} in MLflow", params[name]
                raise InputError(fault, place=place, key=name, expected=value, found=now, fix=fix)
        tags = {**wanted.tags} | ({NOTE_TAG: wanted.note} if wanted.note else {})
        new = _each(Param, _new(params, run.data.params)), _each(RunTag, _new(tags, run.data.tags))
        self._client.log_batch(run.info.run_id, params=new[0], tags=new[1])
        page = {NOTE_TAG: wanted.about} if wanted.about else {}
        if wanted.columns:
            page[VIEW_TAG] = view(wanted, run.info.run_id)
        experiment_tags = self._client.get_experiment(self._experiment).tags
        for name, value in _new(page, experiment_tags).items():
            self._client.set_experiment_tag(self._experiment, name, value)
        if run.info.status != "RUNNING":
            self._client.update_run(run.info.run_id, status="RUNNING")


def _is_whole(run: Any) -> bool:
    """Tell whether a trial's run has all that it is to have."""
    status, tags = run.info.status, run.data.tags
    ended = status == "FINISHED" or (status == "FAILED" and ERROR_TAG in tags)
    return ended and REFUSED_TAG not in tags


def _error(run: Any) -> str | None:
    return None if run.info.status == "FINISHED" else str(run.data.tags[ERROR_TAG])


def _short(error: str | None) -> str | None:
    return None if error is None else error[:_LONGEST_REASON]


def _tags_of(trial: EndedTrial, content: TrialRun) -> dict[str, str]:
    error = _short(trial.error)
    return _texts(content.tags) | ({} if error is None else {ERROR_TAG: error})


def _texts(values: Mapping[str, object]) -> dict[str, str]:
    return {name: str(value) for name, value in values.items()}


def _new(values: Mapping[str, str], logged: Mapping[str, str]) -> dict[str, str]:
    """Select the values that are not logged yet."""
    return {name: value for name, value in values.items() if logged.get(name) != value}


def _each(kind: Callable[[str, str], Any], values: Mapping[str, str]) -> list[Any]:
    return [kind(name, value) for name, value in values.items()]


def _input(dataset: Dataset) -> Any:
    from mlflow.entities import Dataset as MlflowDataset
    from mlflow.entities import DatasetInput, InputTag
    from mlflow.utils.mlflow_tags import MLFLOW_DATASET_CONTEXT

    about = {"source": json.dumps(dataset.source), "profile": json.dumps(dataset.profile)}
    mlflow_dataset = MlflowDataset(dataset.name, dataset.digest, source_type="lidarplace", **about)
    return DatasetInput(mlflow_dataset, [InputTag(MLFLOW_DATASET_CONTEXT, dataset.context)])
