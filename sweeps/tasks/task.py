"""A unit of work: what is computed, from what, and the hash that names its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Generic, get_type_hints

import numpy as np
from pydantic import BaseModel
from typing_extensions import TypeVar

from lidarplace.base.metrics import METRICS
from lidarplace.pog.surrogates.table import SURROGATES
from lidarplace.rigs.placement import Placement
from lidarplace.scenes.parts import Recording
from sweeps.tasks import stages
from sweeps.tasks.code_version import code_version
from sweeps.tasks.parameters import keys_of
from training import code_of_network, network_of

R = TypeVar("R", covariant=True, default=Any)
"""What a task's stage returns."""


@dataclass(frozen=True, eq=False)
class Task(Generic[R]):
    """One call of a function of `sweeps.tasks.stages`, by its name. `label`: what a person calls
    it. `params`: what the result depends on besides the inputs, see `sweeps.tasks.parameters`.
    `inputs`: tasks whose results are handed to the function, in this order. `gpu`: whether the work
    runs on a GPU where there is one. `resumable`: whether the function takes a `folder` from which
    it goes on after a stop."""

    stage: str
    label: str
    params: Any
    inputs: tuple[Task, ...] = ()
    gpu: bool = False
    resumable: bool = False

    @property
    def result(self) -> type[R]:
        found: type[R] = get_type_hints(stages.FUNCTIONS[self.stage])["return"]
        return found

    @cached_property
    def uses(self) -> frozenset[str]:
        """Key paths of the configuration that decide the result."""
        return keys_of(self.params).union(*(task.uses for task in self.inputs))

    @cached_property
    def key(self) -> str:
        """Hash of all that determines the result: parameters, inputs and the code that can run."""
        content = {
            "stage": self.stage,
            "params": self.params,
            "inputs": [task.key for task in self.inputs],
            "code": code_of(
                self.stage,
                getattr(self.params, "detector", None),
                getattr(self.params, "recording", None),
                SURROGATES.roots(getattr(self.params, "names", ())),
                METRICS.roots(getattr(self.params, "metrics", ())),
            ),
        }
        text = json.dumps(content, sort_keys=True, allow_nan=False, default=plain)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


def with_inputs(tasks: Iterable[Task]) -> list[Task]:
    """Tasks and all that they need, each once and after its inputs."""
    found: dict[str, Task] = {}

    def add(task: Task) -> None:
        if task.key not in found:
            for needed in task.inputs:
                add(needed)
            found[task.key] = task

    for task in tasks:
        add(task)
    return list(found.values())


def plain(value: Any) -> Any:
    """Parameters of a stage, or a part of them, for `json.dumps`."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray):
        return [value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    known = {item.name: getattr(value, item.name) for item in fields(value) if item.compare}
    if isinstance(value, Placement):
        known.pop("name")  # a rig of two names is computed once
    return known


def code_of(
    stage: str,
    detector: str | None = None,
    recording: Recording | None = None,
    *plug_ins: tuple[str, ...],
) -> str:
    """Version of the code that a stage can run: of all networks and kinds of scenes its own, and
    the dotted paths of `plug_ins`, see `Registry.roots`."""
    roots = [f"{stages.__name__}.{stage}", *chain(*plug_ins)]
    if detector is not None:
        roots += code_of_network(network_of(detector))
    if recording is not None:
        roots.append(f"{type(recording).__module__}.{type(recording).__qualname__}")
    return code_version(*roots)
