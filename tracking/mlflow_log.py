"""A sweep in MLflow: one experiment, a parent run, and a child run for every trial."""

from __future__ import annotations

import logging
import os
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pandas as pd

from tracking.labels import in_order
from tracking.summary import surrogates_of

SWEEP_TAG = "lidarplace.sweep"
TRIAL_TAG = "lidarplace.trial"
ERROR_TAG = "lidarplace.error"

_METRICS_A_BATCH = 1000  # MLflow's limits of one call
_PARAMS_A_BATCH = 100


class SweepLog:
    """Writes a sweep to MLflow. Only one process may do so at a time: the driver.

    The parent run and the trials are found again by tags. A resumed sweep continues its parent
    run; a trial that is finished is left alone; one that was cut half way, or failed, continues in
    its run, and what was logged of it is not logged again.

        with SweepLog("sqlite:///runs/mlflow.db", "demo", key, params) as log:
            log.trial("3f2a", "line · pointpillars_tiny · seed 1", params, metrics, curve)
            log.artifact(run / "report.html")

    At the end of the `with` block the parent is FINISHED; FAILED after an exception, KILLED after
    Ctrl-C.

    Args:
        uri: MLflow's tracking URI. For `sqlite:///FILE` the folder is made, and artifacts go to
            `artifacts` beside the file.
        name: of the experiment and of the parent run.
        sweep_key: tells this sweep from others of the experiment; the same when it is resumed.
        params: of the parent run.

    Raises:
        ValueError: the URI cannot hold runs, `sweep_key` has odd characters, the experiment was
            deleted, or a parameter is not what it was when the sweep began.
    """

    def __init__(self, uri: str, name: str, sweep_key: str, params: Mapping[str, object]) -> None:
        if not re.fullmatch(r"[\w.-]+", sweep_key):  # MLflow's filters know no escape
            raise ValueError(
                f"sweep_key may have letters, digits, '_', '-' and '.', found {sweep_key!r}"
            )
        self.uri = _absolute(uri)
        self.name = name
        self.sweep_key = sweep_key
        self._params = dict(params)
        self._client: Any = None
        self._experiment = ""
        self._parent = ""
        self._trials: dict[str, Any] = {}

    @property
    def parent_run_id(self) -> str:
        """MLflow's id of the parent run; empty before the `with` block."""
        return self._parent

    def __enter__(self) -> SweepLog:
        os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"
        from mlflow import MlflowClient  # heavy, and reads the environment when imported

        # The steps of creating a database are no news for a reader of the sweep's output.
        for logger in ("mlflow.store.db.utils", "alembic"):
            logging.getLogger(logger).setLevel(logging.WARNING)
        database = _sqlite_file(self.uri)
        if database is not None:
            database.parent.mkdir(parents=True, exist_ok=True)
        self._client = MlflowClient(tracking_uri=self.uri)
        self._experiment = self._find_experiment(database)
        runs = self._sweep_runs()
        self._trials = {r.data.tags[TRIAL_TAG]: r for r in runs if TRIAL_TAG in r.data.tags}
        parents = [run for run in runs if TRIAL_TAG not in run.data.tags]
        parent = parents[0] if parents else self._create(self.name, {})
        self._parent = parent.info.run_id
        self._log_params(parent, self._params)
        self._client.update_run(self._parent, status="RUNNING")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        status = "FINISHED"
        if kind is not None:
            status = "KILLED" if issubclass(kind, KeyboardInterrupt) else "FAILED"
        self._client.set_terminated(self._parent, status)

    def trial(
        self,
        key: str,
        run_name: str,
        params: Mapping[str, object],
        metrics: Mapping[str, float],
        curve: pd.DataFrame | None = None,
        error: str | None = None,
    ) -> bool:
        """Log one trial as a child run.

        Args:
            key: tells the trial from others of the sweep; the same when the sweep is resumed.
            run_name: shown in the UI, such as "line · pointpillars_tiny · seed 1".
            metrics: one value each; those that are not finite are left out.
            curve: epoch, metric, value; the epoch becomes MLflow's step.
            error: why the trial failed; its run gets the status FAILED.

        Returns:
            False if the trial was finished already and nothing was written.
        """
        run = self._trials.get(key)
        if run is not None and run.info.status == "FINISHED":
            return False
        if run is None:
            run = self._create(run_name, {TRIAL_TAG: key, "mlflow.parentRunId": self._parent})
        run_id = run.info.run_id
        self._log_params(run, params)
        self._log_metrics(run, _points(metrics, curve))
        if error is None:
            if ERROR_TAG in run.data.tags:
                self._client.delete_tag(run_id, ERROR_TAG)
            self._client.set_terminated(run_id, "FINISHED")
        else:
            self._client.set_tag(run_id, ERROR_TAG, error[:5000])
            self._client.set_terminated(run_id, "FAILED")
        self._trials[key] = self._client.get_run(run_id)
        return True

    def artifact(self, path: Path, folder: str | None = None) -> None:
        """Copy a file to the artifacts of the parent run, into `folder` of them."""
        self._client.log_artifact(self._parent, str(path), folder)

    def _find_experiment(self, database: Path | None) -> str:
        experiment = self._client.get_experiment_by_name(self.name)
        if experiment is None:
            place = None if database is None else (database.parent / "artifacts").as_uri()
            # The kind decides which of its two faces the UI shows: this is model training.
            tags = {"mlflow.experimentKind": "custom_model_development"}
            return str(self._client.create_experiment(self.name, place, tags))
        if experiment.lifecycle_stage != "active":
            raise ValueError(
                f"the MLflow experiment {self.name!r} was deleted: restore it, or give the sweep "
                "another name"
            )
        return str(experiment.experiment_id)

    def _sweep_runs(self) -> list[Any]:
        """All runs of this sweep, the parent among them."""
        runs: list[Any] = []
        token = None
        while True:
            page = self._client.search_runs(
                [self._experiment],
                filter_string=f"tags.`{SWEEP_TAG}` = '{self.sweep_key}'",
                max_results=1000,
                page_token=token,
            )
            runs += page
            token = page.token
            if not token:
                return runs

    def _create(self, name: str, tags: dict[str, str]) -> Any:
        return self._client.create_run(
            self._experiment, run_name=name, tags={SWEEP_TAG: self.sweep_key, **tags}
        )

    def _log_params(self, run: Any, params: Mapping[str, object]) -> None:
        from mlflow.entities import Param

        wanted = {name: str(value) for name, value in params.items()}
        for name, value in run.data.params.items():
            if wanted.get(name, value) != value:
                raise ValueError(
                    f"run {run.info.run_name!r} in MLflow has {name} = {value}, now it is "
                    f"{wanted[name]}: a resumed sweep cannot change it, give it another name"
                )
        new = [Param(name, wanted[name]) for name in wanted if name not in run.data.params]
        for start in range(0, len(new), _PARAMS_A_BATCH):
            self._client.log_batch(run.info.run_id, params=new[start : start + _PARAMS_A_BATCH])

    def _log_metrics(self, run: Any, points: Sequence[tuple[str, int, float]]) -> None:
        from mlflow.entities import Metric

        run_id = run.info.run_id
        there = {
            (name, point.step)
            for name in run.data.metrics
            for point in self._client.get_metric_history(run_id, name)
        }
        new = [
            Metric(name, value, run.info.start_time, step)
            for name, step, value in points
            if (name, step) not in there
        ]
        for start in range(0, len(new), _METRICS_A_BATCH):
            self._client.log_batch(run_id, metrics=new[start : start + _METRICS_A_BATCH])


def trial_metrics(
    results: pd.DataFrame, surrogates: pd.DataFrame, placement: str, setting: Mapping[str, object]
) -> dict[str, float]:
    """Metrics of one trial by their names in MLflow.

    `AP_R40_3D.Car.0.70` for every row of `results`, the rows of one trial; and
    `surrogate.s_mig.Car` for the surrogates of its placement at its `setting` of the further axes.
    """
    named = {
        f"{row['metric']}.{row['class']}.{row['iou']:.2f}": float(row["value"])
        for row in results.to_dict("records")
    }
    for object_class in surrogates["class"].unique():
        own = surrogates_of(surrogates, dict(setting), object_class)
        if placement in own.index:
            for name in in_order(own.columns):
                named[f"surrogate.{name}.{object_class}"] = own[name].astype(float)[placement]
    return named


def ui_command(uri: str) -> str:
    """The command line that opens the experiments in a browser of this machine."""
    store = shlex.quote(_absolute(uri))
    return (
        f"MLFLOW_DISABLE_TELEMETRY=true {shlex.quote(sys.executable)} -m mlflow ui "
        f"--backend-store-uri {store} --host 127.0.0.1 --port 5000"
    )


def _points(
    metrics: Mapping[str, float], curve: pd.DataFrame | None
) -> list[tuple[str, int, float]]:
    """(name, step, value) of all finite values."""
    points = [(name, 0, float(value)) for name, value in metrics.items()]
    if curve is not None:
        points += [
            (str(row["metric"]), int(row["epoch"]), float(row["value"]))
            for row in curve.to_dict("records")
        ]
    return [point for point in points if np.isfinite(point[2])]


def _sqlite_file(uri: str) -> Path | None:
    """The database file of a `sqlite:///` URI, None for other URIs."""
    match = re.fullmatch(r"sqlite:///(.+)", uri)
    return Path(match[1]) if match else None


def _absolute(uri: str) -> str:
    """`uri`, a database file in it as an absolute path: MLflow stores places for later.

    Raises:
        ValueError: MLflow cannot keep runs there.
    """
    if "://" not in uri or uri.startswith("file:"):
        raise ValueError(
            f"MLflow keeps runs in a database or on a server, for example sqlite:///runs/mlflow.db "
            f"or http://host:5000; found {uri!r}"
        )
    database = _sqlite_file(uri)
    return uri if database is None else f"sqlite:///{database.resolve()}"
