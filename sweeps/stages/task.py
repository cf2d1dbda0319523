"""A unit of work: a stage, the tasks that it starts from, and the hash that names its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, cast

import numpy as np
from pydantic import BaseModel
from typing_extensions import TypeVar

from lidarplace.base.code_version import OMIT_DEFAULT, code_version
from lidarplace.rigs.placement import Placement
from sweeps.stages.stage import Stage

S = TypeVar("S", bound=Stage, covariant=True, default=Stage)
"""Stage of a task."""
T = TypeVar("T", bound=Stage)


@dataclass(frozen=True, eq=False)
class Task(Generic[S]):
    """One run of a stage.

    `label`: names it for people. `inputs`: tasks whose results `Stage.run` gets, in this order."""

    stage: S
    label: str
    inputs: tuple[Task, ...] = ()

    @cached_property
    def keys(self) -> frozenset[str]:
        """Key paths of the configuration that decide the result."""
        return self.stage.config_keys().union(*(task.keys for task in self.inputs))

    @cached_property
    def key(self) -> str:
        """Hash of all that decides the result: parameters, inputs and the code that can run."""
        content = {
            "stage": self.stage.name,
            "parameters": self.stage,
            "inputs": [task.key for task in self.inputs],
            "code": code_version(*self.stage.modules()),
        }
        text = json.dumps(content, sort_keys=True, allow_nan=False, default=plain)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


def tasks_of(kind: type[T], tasks: Iterable[Task]) -> list[Task[T]]:
    """Select the tasks of a stage."""
    return [cast(Task[T], task) for task in tasks if isinstance(task.stage, kind)]


def with_inputs(tasks: Iterable[Task]) -> list[Task]:
    """List tasks and all that they need, each once and after its inputs."""
    by_key: dict[str, Task] = {}

    def add(task: Task) -> None:
        if task.key not in by_key:
            for needed in task.inputs:
                add(needed)
            by_key[task.key] = task

    for task in tasks:
        add(task)
    return list(by_key.values())


def plain(value: Any) -> Any:
    """Convert fields of a stage, or parts of them, for `json.dumps`."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray):
        return [value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    compared = ((item, getattr(value, item.name)) for item in fields(value) if item.compare)
    content = {
        item.name: content
        for item, content in compared
        if not (item.metadata.get(OMIT_DEFAULT) and content == item.default)
    }
    if isinstance(value, Placement):
        content.pop("name")  # a rig of two names is computed once
    return content
