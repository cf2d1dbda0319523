"""The runs of one sweep at MLflow: found again by tags, so that nothing is written twice."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lidarplace.files.secret_urls import public_url
from tracking.mlflow.connection import (
    connect,
    is_away,
    is_forbidden,
    is_server_error,
    reason,
)
from tracking.mlflow.delivery import Away
from tracking.mlflow.journal import (
    ArtifactEntry,
    Dataset,
    Entry,
    ModelEntry,
    SampleEntry,
    StatusEntry,
    SweepEntry,
    TrialEntry,
)
from tracking.mlflow.models import write_model
from tracking.mlflow.page import NOTE_TAG, VIEW_TAG, page_of, view
from tracking.mlflow.uri import is_server

SWEEP_TAG = "lidarplace.sweep"
TRIAL_TAG = "lidarplace.trial"
ERROR_TAG = "lidarplace.error"
PARENT_TAG = "mlflow.parentRunId"


class SweepRuns:
    """Writes entries to the parent run and the child runs of a sweep.

    A trial that is finished is left alone; one that was cut half way, or failed, continues in its
    run, and what was logged of it is not logged again. So any entry may be written again.

    Args:
        uri: absolute.
        artifacts: where a new experiment keeps artifacts if MLflow writes to a database itself.
    """

    def __init__(self, uri: str, sweep: SweepEntry, artifacts: Path) -> None:
        self._uri = uri
        self._sweep = sweep
        self._artifacts = artifacts
        self._client: Any = None
        self._experiment = ""
        self._parent: Any = None
        self._trials: dict[str, Any] = {}
        self._last_steps: dict[str, int] = {}
        self.finished: set[str] = set()
        """Keys of the trials that are finished."""

    def open(self) -> None:
        """Find, or make, the experiment and the parent run, and find the trials.

        Raises:
            ValueError: the server cannot take this sweep.
            Away: there is no connection now.
        """
        try:
            self._client = connect(self._uri)
            self._experiment = self._find_experiment()
            runs = self._find_runs()
            self._trials = self._one_each([r for r in runs if TRIAL_TAG in r.data.tags])
            self.finished = {k for k, r in self._trials.items() if r.info.status == "FINISHED"}
            self._parent = self._one_parent([r for r in runs if TRIAL_TAG not in r.data.tags])
            self._describe()
        except ValueError:
            self._client = None
            raise
        except Exception as error:
            self._client = None
            if is_away(error, self._uri) and not is_forbidden(error):
                raise Away(reason(error)) from error
            raise ValueError(f"{public_url(self._uri)}: {reason(error)}") from error

    def write(self, entry: Entry) -> None:
        """Write one entry, after `open` if need be.

        Raises:
            Away: it may or may not be written; the next call finds out.
            Exception: MLflow does not take it.
        """
        try:
            if self._client is None:
                self.open()
        except ValueError as error:  # a person may mend it, until then everything waits
            raise Away(str(error)) from error
        try:
            if isinstance(entry, TrialEntry):
                self._write_trial(entry)
            elif isinstance(entry, ArtifactEntry):
                self._write_artifact(entry)
            elif isinstance(entry, SampleEntry):
                self._write_sample(entry)
            elif isinstance(entry, ModelEntry):
                run = self._run_of(entry.trial)
                write_model(self._client, self._experiment, run, entry)
            elif isinstance(entry, StatusEntry):
                self._write_status(entry.status)
        except Exception as error:
            is_file = isinstance(entry, (ArtifactEntry, ModelEntry))
            unwritable = is_file and is_server_error(error)
            if is_away(error, self._uri) and not unwritable:
                self._client = None
                raise Away(reason(error)) from error
            if isinstance(entry, TrialEntry) and entry.key in self._trials:
                # A run without its data must not look as if it were still going on.
                self._client.set_terminated(self._trials[entry.key].info.run_id, "FAILED")
            raise

    def _write_trial(self, entry: TrialEntry) -> None:
        from mlflow.entities import Metric, Param, RunTag

        if entry.key in self.finished:
            return
        run = self._trials.get(entry.key)
        points = entry.points
        params = entry.params
        tags = entry.tags | ({} if entry.error is None else {ERROR_TAG: entry.error})
        if run is None:
            names = {TRIAL_TAG: entry.key, PARENT_TAG: self._parent.info.run_id}
            started = entry.time - round(1000 * entry.seconds)
            run = self._create(entry.run_name, {**tags, **names}, started)
            self._trials[entry.key] = run
            tags = {}
        else:
            run = self._client.get_run(run.info.run_id)
            there = self._points_of(run)
            points = tuple(point for point in points if point[:2] not in there)
            params = {k: v for k, v in params.items() if run.data.params.get(k) != v}
            if entry.error is None and ERROR_TAG in run.data.tags:
                self._client.delete_tag(run.info.run_id, ERROR_TAG)
        run_id = run.info.run_id
        self._client.log_batch(
            run_id,
            [Metric(name, value, run.info.start_time, step) for name, step, value in points],
            [Param(name, value) for name, value in params.items()],
            [RunTag(name, value) for name, value in tags.items()],
        )
        if entry.datasets:
            self._client.log_inputs(run_id, [_input(dataset) for dataset in entry.datasets])
        self._client.set_terminated(
            run_id, "FINISHED" if entry.error is None else "FAILED", entry.time
        )
        if entry.error is None:
            self.finished.add(entry.key)

    def _write_artifact(self, entry: ArtifactEntry) -> None:
        if not Path(entry.path).is_file():
            raise ValueError(f"{entry.path} is gone")
        run = self._parent if entry.trial is None else self._run_of(entry.trial)
        self._client.log_artifact(run.info.run_id, entry.path, entry.folder)

    def _run_of(self, trial: str) -> Any:
        if trial not in self._trials:
            raise ValueError(f"trial {trial} has no run")
        return self._trials[trial]

    def _write_sample(self, entry: SampleEntry) -> None:
        """Samples arrive in the order of their steps, so what is not after the last is there."""
        from mlflow.entities import Metric

        info = self._parent.info
        step = (entry.time - info.start_time) // 1000
        new = {k: v for k, v in entry.values.items() if step > self._last_steps.get(k, -1)}
        points = [Metric(name, value, entry.time, step) for name, value in new.items()]
        self._client.log_batch(info.run_id, points)
        self._last_steps |= dict.fromkeys(new, step)

    def _write_status(self, status: str) -> None:
        run_id = self._parent.info.run_id
        if status == "RUNNING":
            self._client.update_run(run_id, status=status)
        else:
            self._client.set_terminated(run_id, status)

    def _find_experiment(self) -> str:
        name = self._sweep.name
        experiment = self._client.get_experiment_by_name(name)
        if experiment is None:
            place = None if is_server(self._uri) else self._artifacts.resolve().as_uri()
            # The kind decides which of its two faces the UI shows: this is model training.
            tags = {"mlflow.experimentKind": "custom_model_development"}
            return str(self._client.create_experiment(name, place, tags))
        if experiment.lifecycle_stage != "active":
            raise ValueError(
                f"the MLflow experiment {name!r} was deleted: restore it, or give the sweep "
                "another name"
            )
        return str(experiment.experiment_id)

    def _find_runs(self) -> list[Any]:
        """All runs of this sweep, the parent among them, oldest first."""
        runs: list[Any] = []
        token = None
        while True:
            page = self._client.search_runs(
                [self._experiment],
                filter_string=f"tags.`{SWEEP_TAG}` = '{self._sweep.sweep}'",
                max_results=1000,
                order_by=["attributes.start_time ASC"],
                page_token=token,
            )
            runs += page
            token = page.token
            if not token:
                return runs

    def _one_each(self, runs: list[Any]) -> dict[str, Any]:
        """The run of each trial. A server that answered too late may have made a second one."""
        trials: dict[str, Any] = {}
        for run in sorted(runs, key=lambda run: run.info.status != "FINISHED"):
            if run is not trials.setdefault(run.data.tags[TRIAL_TAG], run):
                self._client.delete_run(run.info.run_id)
        return trials

    def _one_parent(self, parents: list[Any]) -> Any:
        """The parent run: the oldest, for the same reason. All trials become its children."""
        parent, *others = parents or [self._create(self._sweep.name, {}, None)]
        for run in others:
            self._client.delete_run(run.info.run_id)
        for run in self._trials.values():
            if run.data.tags.get(PARENT_TAG) != parent.info.run_id:
                self._client.set_tag(run.info.run_id, PARENT_TAG, parent.info.run_id)
        return parent

    def _create(self, name: str, tags: dict[str, str], time: int | None) -> Any:
        return self._client.create_run(
            self._experiment,
            time,
            {SWEEP_TAG: self._sweep.sweep, **self._sweep.tags, **tags},
            name,
        )

    def _describe(self) -> None:
        """Parameters and tags of the parent run, and what the experiment's page shows."""
        from mlflow.entities import Param, RunTag

        wanted, run = self._sweep.params, self._client.get_run(self._parent.info.run_id)
        for name, value in run.data.params.items():
            if wanted.get(name, value) != value:
                raise ValueError(
                    f"run {run.info.run_name!r} in MLflow has {name} = {value}, now it is "
                    f"{wanted[name]}: a resumed sweep cannot change it, give it another name"
                )
        self._last_steps = {point.key: point.step for point in run.data.to_proto().metrics}
        tags = self._sweep.tags | ({NOTE_TAG: self._sweep.note} if self._sweep.note else {})
        self._client.log_batch(
            run.info.run_id,
            params=[Param(name, wanted[name]) for name in wanted if name not in run.data.params],
            tags=[RunTag(k, v) for k, v in tags.items() if run.data.tags.get(k) != v],
        )
        page = {NOTE_TAG: self._sweep.about} if self._sweep.about else {}
        if self._sweep.columns:
            page[VIEW_TAG] = view(self._sweep.columns, self._sweep.ascending, run.info.run_id)
        there = self._client.get_experiment(self._experiment).tags
        for name, value in page.items():
            if there.get(name) != value:
                self._client.set_experiment_tag(self._experiment, name, value)

    def page(self) -> str:
        """The experiment's page below the server's address; empty before `open` succeeded."""
        return page_of(self._experiment, bool(self._sweep.columns)) if self._experiment else ""

    def _points_of(self, run: Any) -> set[tuple[str, int]]:
        """(metric, step) of all that was logged."""
        return {
            (name, point.step)
            for name in run.data.metrics
            for point in self._client.get_metric_history(run.info.run_id, name)
        }


def _input(dataset: Dataset) -> Any:
    from mlflow.entities import Dataset as MlflowDataset
    from mlflow.entities import DatasetInput, InputTag
    from mlflow.utils.mlflow_tags import MLFLOW_DATASET_CONTEXT

    described = MlflowDataset(
        name=dataset.name,
        digest=dataset.digest,
        source_type="lidarplace",
        source=json.dumps(dataset.source),
        profile=json.dumps(dataset.profile),
    )
    return DatasetInput(described, [InputTag(MLFLOW_DATASET_CONTEXT, dataset.context)])
