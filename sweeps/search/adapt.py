"""A search in two rounds: weights that come along evaluate the first, adapted ones the second.

Each round is a search with a run folder of its own, so a stop loses nothing of either. The second
starts from the best rigs of the first, and its generalist is trained on rigs near these.
"""

import json
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from sweeps.configuration.search import GENERALIST
from sweeps.search.problem.problem import Problem, read_problem
from sweeps.search.verification.chosen import MOST_CHOSEN
from tracking.run_folders.search import SearchFolder

_POSE = ("x", "y", "z", "roll", "pitch", "yaw")
FIRST = "_first"
"""What the name of the first round ends with."""


def first_round(problem: Problem, path: Path, overrides: Sequence[str]) -> Problem:
    """The search with so many trials as `search.adapt` says, without verification."""
    changes: dict[str, Any] = dict.fromkeys(("search.adapt", "robustness", "verify"))
    changes |= {"name": problem.file.name + FIRST, "search.trials": problem.file.search.adapt}
    return _changed(path, overrides, changes)


def second_round(problem: Problem, first: Problem, path: Path, overrides: Sequence[str]) -> Problem:
    """The search from the best rigs of the first round, by weights that are trained near these."""
    rigs = SearchFolder.read(first.folder).search.rigs.items()
    best = {
        f"first_{name.removeprefix('found_')}": [
            dict(zip(_POSE, m, strict=True)) for m in rig.mounts
        ]
        for name, rig in islice((own for own in rigs if own[1].role == "found"), MOST_CHOSEN)
    }
    assert problem.file.search.adapt is not None
    adapted = {"evaluator": GENERALIST}
    changes: dict[str, Any] = {
        "search.adapt": None,
        "search.trials": problem.file.search.trials - problem.file.search.adapt,
        "search.families": 0,
        "search.near_start": True,
        "search.start": [*problem.file.search.start, *best],
        "search.objective": [
            own.model_dump(mode="json", exclude_none=True) | (adapted if own.measured else {})
            for own in problem.file.search.objective
        ],
        "training.checkpoint": str(problem.file.training.checkpoint or "pretrained"),
    }
    changes |= {f"placements.{name}": {"mounts": mounts} for name, mounts in best.items()}
    return _changed(path, overrides, changes)


def _changed(path: Path, overrides: Sequence[str], changes: dict[str, Any]) -> Problem:
    return read_problem(path, [*overrides, *(f"{k}={json.dumps(v)}" for k, v in changes.items())])
