"""What MLflow is to have of a sweep: a parent run, and a run for every trial."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Literal

import pandas as pd

from lidarplace.base.metrics import EVERY_IOU
from lidarplace.requirements.tables import worst_cases


@dataclass(frozen=True)
class ParentRun:
    """The run of a sweep, in an experiment of its name.

    Attributes:
        key: distinguishes this sweep from others of the experiment; the same when it is resumed.
        name: of the experiment and of the run.
        tags: of this run and of those of the trials.
        note: text of the run's page, Markdown.
        about: text of the experiment's page, Markdown.
        columns: what the experiment's page shows of every run, by MLflow's names, such as
            "metrics.seconds"; the first orders the runs.
        ascending: whether the lowest of the first column is on top, else the highest.

    Raises:
        ValueError: the key has odd characters.
    """

    key: str
    name: str
    params: Mapping[str, object]
    tags: Mapping[str, str] = field(default_factory=dict)
    note: str = ""
    about: str = ""
    columns: Sequence[str] = ()
    ascending: bool = False

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[\w.-]+", self.key):  # MLflow's filters know no escape
            raise ValueError(
                f"key of a sweep: may have letters, digits, '_', '-' and '.', found {self.key!r}"
            )


@dataclass(frozen=True)
class Dataset:
    """Data that a trial was trained or tested on: a name for it, no copy.

    Attributes:
        source: where it comes from.
        profile: how much it is.
    """

    name: str
    digest: str
    context: Literal["train", "test"]
    source: Mapping[str, str]
    profile: Mapping[str, int]


@dataclass(frozen=True)
class TrialRun:
    """The run of a trial.

    Attributes:
        name: shown in the UI, such as "line · pointpillars_tiny · seed 1".
        metrics: one value each; those that are not finite are left out. "seconds" is also the
            duration of the run.
        ended: when, milliseconds since 1970.
        curve: epoch, metric, value; the epoch becomes MLflow's step.
        tags: to filter by.
        datasets: what it was trained and tested on.
        files: its artifacts.
    """

    name: str
    params: Mapping[str, object]
    metrics: Mapping[str, float]
    ended: int
    curve: pd.DataFrame | None = None
    tags: Mapping[str, object] = field(default_factory=dict)
    datasets: Sequence[Dataset] = ()
    files: Sequence[Path] = ()

    def points(self) -> Iterator[tuple[str, int, float]]:
        """Metric, step and value of all that is finite."""
        points = [(name, 0, float(value)) for name, value in self.metrics.items()]
        if self.curve is not None:
            columns = (self.curve[name].tolist() for name in ("metric", "epoch", "value"))
            points += zip(*columns, strict=True)
        return (point for point in points if isfinite(point[2]))


@dataclass(frozen=True)
class EndedTrial:
    """A trial that has ended, and how to find out what its run is to hold.

    Attributes:
        key: distinguishes the trial from others of the sweep; the same when the sweep is resumed.
        describe: is called if MLflow has not got it all.
        error: why the trial failed.
    """

    key: str
    describe: Callable[[], TrialRun]
    error: str | None = None


def trial_metrics(results: pd.DataFrame, surrogates: pd.DataFrame) -> dict[str, float]:
    """Metrics of one trial by their names in MLflow.

    Args:
        results: rows of this trial: `AP_R40_3D.Car.0.70`, `mean_overlap.Car`; may be empty.
        surrogates: rows of its placement at its setting of the further axes:
            `surrogate.s_mig.Car`.
    """
    named = {
        f"{row['metric']}.{row['class']}" + _at(row["iou"]): float(row["value"])
        for row in results.to_dict("records")
    }
    columns = (surrogates[name].tolist() for name in ("surrogate", "class", "value"))
    return named | {
        f"surrogate.{name}.{object_class}": float(value)
        for name, object_class, value in zip(*columns, strict=True)
    }


def requirement_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Metrics of what is required of a placement, by their names in MLflow.

    `requirement.NAME` is what there is in the worst case, in terms of what is needed: 1 is just
    enough; `requirements_failed` counts those that have less. Characters of a name that MLflow
    takes in none are underscores.

    Args:
        cases: rows of `lidarplace.requirements.tables.case_table`.
    """
    worst = worst_cases(cases, [])
    shares = (worst["value"] / worst["at_least"]).tolist()
    names = (re.sub(r"[^\w .-]", "_", name) for name in worst["requirement"])
    found = {f"requirement.{name}": share for name, share in zip(names, shares, strict=True)}
    return found | {"requirements_failed": float((~worst["met"]).sum())}


def _at(iou: float) -> str:
    return "" if iou == EVERY_IOU else f".{iou:.2f}"
