"""A unit of work: what is computed, from what, and the hash that names its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import lidarplace
import training

_ROOTS = {package.__name__: Path(package.__path__[0]) for package in (lidarplace, training)}
_STAGES_FILE = Path(__file__).with_name("stages.py")

PACKAGES = dict.fromkeys(("probe", "pretrain", "finetune", "evaluate"), ("lidarplace", "training"))
"""Packages whose code decides a stage's result; `lidarplace` alone for the others."""


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
        """Hash of all that determines the result: parameters, inputs and the code."""
        content = {
            "stage": self.stage,
            "params": self.params,
            "inputs": [task.key for task in self.inputs],
            "code": code_version(*PACKAGES.get(self.stage, ("lidarplace",))),
        }
        text = json.dumps(content, sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


@cache
def code_version(*packages: str) -> str:
    """Hash of the sources of `packages` and of the stages' functions."""
    digest = hashlib.sha256(_STAGES_FILE.read_bytes())
    for package in packages:
        root = _ROOTS[package]
        for path in sorted(root.rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
