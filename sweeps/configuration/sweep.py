"""The configuration of a sweep: settings of all points of its grid."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from lidarplace.base.errors import InputError
from lidarplace.base.metrics import METRICS, RANKING, Direction
from lidarplace.base.registry import OneOf
from lidarplace.configuration.placement import SweptPlacementSettings
from lidarplace.configuration.settings import (
    Amount,
    ClassName,
    Count,
    CountFromOne,
    FilePath,
    Name,
    Probability,
    Settings,
    Text,
    short_for,
)
from lidarplace.pog.surrogates.table import ASKED_FOR, SURROGATES
from lidarplace.requirements.settings import Requirements
from sweeps.configuration.point import Point
from tracking.mlflow.uri import sqlite_uri

NAME = r"^\w[\w.-]*$"
"""Pattern of the name of a sweep or a search, which is the name of a folder, too."""


class RaySettings(Settings):
    """Machines that run the tasks."""

    address: Text = Field(
        "local",
        description="local: this machine; debug: in this process, without Ray; auto, ray://… or "
        "host:port: a running cluster",
    )
    num_cpus: CountFromOne | None = Field(None, description="CPUs of a local run; all by default")
    num_gpus: Count | None = Field(None, description="GPUs of a local run; all by default")
    gpus_per_training: Probability = Field(
        1.0,
        description="share of a GPU, and of its memory, per training, if there is a GPU: 0.25 "
        "trains four at once",
    )

    @field_validator("address")
    @classmethod
    def _known(cls, address: str) -> str:
        if not re.fullmatch(r"local|debug|auto|(ray://)?[^\s:/]+:\d+", address):
            raise InputError(expected="local, debug, auto, HOST:PORT or ray://HOST:PORT")
        return address


class TrackingSettings(Settings):
    """Database of MLflow."""

    uri: Text | None = Field(None, description="tracking URI; sqlite in the output folder if null")


class StoreSettings(Settings):
    """Store of results, for all machines of a sweep."""

    url: Text | None = Field(
        None,
        description="a folder that all machines share, or a URL that fsspec knows, such as "
        "s3://bucket/folder; `store` in the output folder if null",
    )
    cache: FilePath | None = Field(None, description="folder on each machine for results of a URL")
    quota_gb: Amount | None = Field(
        None, gt=0, description="remove unused results beyond this size, oldest first"
    )


def best_of(by: str) -> Direction:
    """Return the direction of a surrogate or a metric unless a user sets it."""
    return SURROGATES[by].direction if by in SURROGATES else METRICS[by].direction


class Rung(Settings):
    """A step of `promote`: the best placements by one value go on to the next."""

    by: Annotated[str, OneOf((ASKED_FOR, RANKING))] = Field(
        description="the value: a surrogate, or a metric of short trainings"
    )
    keep: CountFromOne = Field(description="placements that are kept; equal ones are kept together")
    object_class: ClassName | None = Field(
        None,
        alias="class",
        description="class that counts; by default the sum over classes for a surrogate, the "
        "first class for AP, all objects for recall",
    )
    direction: Direction | None = Field(
        None, description="which values are best; maximize, but minimize for residual_entropy"
    )
    set: dict[str, Any] = Field(
        default={}, description="key path -> value for the trainings of this rung: fewer epochs"
    )

    @model_validator(mode="after")
    def _clear(self) -> Rung:
        if self.by in RANKING and not self.set:
            problem = f"a rung by {self.by} needs shorter trainings than the full ones"
            raise InputError(problem, key="set")
        if self.by not in RANKING and self.set:
            raise InputError(f"nothing is trained for a rung by {self.by}", key="set")
        if self.direction is None and self.by in SURROGATES and SURROGATES[self.by].contested:
            problem = f"{self.by} is highest for a placement that sees nothing"
            fix = "set maximize (as in the paper) or minimize"
            raise InputError(problem, key="direction", fix=fix)
        return self

    @property
    def best(self) -> Direction:
        """Direction of the best values."""
        return self.direction or best_of(self.by)


class Common(Settings):
    """Settings of all points of the grid."""

    name: Name = Field(
        pattern=NAME,
        description="name of the run folder and the experiment; the file's name by default",
    )
    placements: dict[Name, SweptPlacementSettings] = Field(
        default={}, description="own placements by name, in addition to the paper's eight"
    )
    allow_blind_lidars: bool = Field(
        False,
        description="allow LiDARs that see neither ground nor objects in the ROI, such as rear "
        "ones with a front ROI; an error by default",
    )
    ray: Annotated[RaySettings, short_for("address")] = Field(
        RaySettings(), description="where the tasks run; a string is short for address"
    )
    tracking: TrackingSettings = Field(TrackingSettings(), description="MLflow")
    output: FilePath = Field(Path("runs"), description="folder of the run folders")
    store: Annotated[StoreSettings, short_for("url")] = Field(
        StoreSettings(), description="cache of results; a string is short for url"
    )
    promote: tuple[Rung, ...] = Field(
        default=(),
        description="cheap values of all placements first, full trainings for the best only",
    )
    requirements: Requirements = Field(
        (),
        description="what every placement must see around the vehicle (a car by default), as in a "
        "file of requirements; placements that fail are kept",
    )

    @property
    def tracking_uri(self) -> str:
        """URI of MLflow."""
        return self.tracking.uri or sqlite_uri(self.output / "mlflow.db")

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses that may hold secrets."""
        return tuple(filter(None, (self.tracking.uri, self.store.url)))


class SweepFile(Common, Point):
    """A configuration file as a whole; `grid` and `exclude` make many points of one."""

    grid: dict[str, list[Any]] = Field(
        default={}, description="key path -> values: the sweep is the product of these axes"
    )
    exclude: list[dict[str, Any]] = Field(
        default=[], description="axis -> value or list of values: points to leave out"
    )
