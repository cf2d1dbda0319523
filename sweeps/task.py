"""A unit of work: what is computed, from what, and the hash that names its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from sweeps import stages
from sweeps.code_version import code_version
from training import network_of


@dataclass(frozen=True, eq=False)
class Task:
    """One call of a function of `sweeps.stages`.

    Attributes:
        stage: name of the function.
        label: what a person calls it.
        params: plain data that the result depends on, besides the inputs.
        inputs: tasks whose results are handed to the function, in this order.
        gpu: whether the work runs on a GPU where there is one.
        resumable: whether the function takes a `folder` from which it goes on after a stop.
    """

    stage: str
    label: str
    params: Mapping[str, Any]
    inputs: tuple[Task, ...] = ()
    gpu: bool = False
    resumable: bool = False

    @cached_property
    def key(self) -> str:
        """Hash of all that determines the result: parameters, inputs and the code that can run."""
        content = {
            "stage": self.stage,
            "params": self.params,
            "inputs": [task.key for task in self.inputs],
            "code": code_of(self.stage, self.params.get("detector")),
        }
        text = json.dumps(content, sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


def code_of(stage: str, detector: str | None = None) -> str:
    """Version of the code that a stage can run.

    Args:
        detector: name of the one that it builds; None: it builds none.
    """
    # Of all networks the one that the task trains.
    networks = [] if detector is None else [f"training.detectors.{network_of(detector)}"]
    return code_version(f"{stages.__name__}.{stage}", *networks)
