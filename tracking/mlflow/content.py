"""Content of a sweep's runs in MLflow: a parent run, and a run for every trial."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Literal

import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.base.metrics import EVERY_IOU
from lidarplace.requirements.tables import worst_cases


@dataclass(frozen=True)
class ParentRun:
    """Run of a sweep, in an experiment of its name."""

    key: str  # distinguishes this sweep from others of the experiment; the same when it is resumed
    name: str
    params: Mapping[str, object]
    tags: Mapping[str, str] = field(default_factory=dict)  # of this run and of those of the trials
    note: str = ""  # of the run's page, Markdown
    about: str = ""  # of the experiment's
    # what the experiment's page shows of every run, by MLflow's names, such as "metrics.seconds"
    columns: Sequence[str] = ()
    order_by: str = ""  # the column that orders the runs, the highest on top; the first by default
    ascending: bool = False  # the lowest on top
    chart: tuple[str, str] | None = None  # columns of metrics, of the page's scatter: x and y

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[\w.-]+", self.key):  # MLflow's filters know no escape
            wanted = "letters, digits, '_', '-' and '.'"
            raise InputError(key="key", expected=wanted, found=repr(self.key))


@dataclass(frozen=True)
class Dataset:
    """Data that a trial was trained or tested on: its name, source and size; no copy."""

    name: str
    digest: str
    context: Literal["train", "test"]
    source: Mapping[str, str]
    profile: Mapping[str, int]


@dataclass(frozen=True)
class TrialRun:
    """Run of a trial, shown as `name`, such as "line · pointpillars_tiny · seed 1"."""

    name: str
    params: Mapping[str, object]
    metrics: Mapping[str, float]  # one value each; "seconds" is also the duration of the run
    ended: int  # when, milliseconds since 1970
    curve: pd.DataFrame | None = None  # epoch, metric, value; the epoch becomes MLflow's step
    tags: Mapping[str, object] = field(default_factory=dict)
    datasets: Sequence[Dataset] = ()
    files: Sequence[Path] = ()

    def points(self) -> Iterator[tuple[str, int, float]]:
        """List metric, step and value of all that is finite."""
        points = [(name, 0, float(value)) for name, value in self.metrics.items()]
        if self.curve is not None:
            columns = (self.curve[name].tolist() for name in ("metric", "epoch", "value"))
            points += zip(*columns, strict=True)
        return (point for point in points if isfinite(point[2]))


@dataclass(frozen=True)
class EndedTrial:
    """Trial that has ended, by a key that is the same when the sweep is resumed.

    `describe` is called if MLflow has not got all that its run is to hold."""

    key: str
    describe: Callable[[], TrialRun]
    error: str | None = None


def trial_metrics(results: pd.DataFrame, surrogates: pd.DataFrame) -> dict[str, float]:
    """Name the metrics of one trial as in MLflow: `AP_R40_3D.Car.0.70`, `mean_overlap.Car`.

    `results` are rows of this trial; `surrogates` of its placement at its setting of the further
    axes: `surrogate.s_mig.Car`. MLflow's pages have every digit of a number: percentages are
    rounded to two decimals, surrogates to five significant digits; tables have all."""
    named = {
        f"{row['metric']}.{row['class']}"
        + ("" if row["iou"] == EVERY_IOU else f".{row['iou']:.2f}"): round(float(row["value"]), 2)
        for row in results.to_dict("records")
    }
    columns = (surrogates[name].tolist() for name in ("surrogate", "class", "value"))
    return named | {
        f"surrogate.{name}.{object_class}": float(f"{value:.5g}")
        for name, object_class, value in zip(*columns, strict=True)
    }


def requirement_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Name metrics of `lidarplace.requirements.tables.case_table` as in MLflow.

    `requirement.NAME` is what there is in the worst case, in terms of what is needed: 1 is just
    enough; `requirements_failed` counts those that have less, `requirements_open` those that finer
    positions decide. Characters of a name that MLflow does not allow are underscores."""
    worst = worst_cases(cases, [])
    shares = (worst["value"] / worst["at_least"]).tolist()
    names = (re.sub(r"[^\w .-]", "_", name) for name in worst["requirement"])
    by_name = {f"requirement.{name}": share for name, share in zip(names, shares, strict=True)}
    is_open = worst["undecided"] > 0
    failed = float((~worst["met"] & ~is_open).sum())
    return by_name | {"requirements_failed": failed, "requirements_open": float(is_open.sum())}
