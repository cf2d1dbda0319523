"""A search in two rounds: shipped weights evaluate the first, adapted ones the second.

Each round is a search with a run folder of its own, so a stop loses nothing of either. The second
starts from the best rigs of the first, and its generalist is trained on rigs near these."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sweeps.configuration.objective import GENERALIST
from sweeps.search.problem.problem import ADAPTED, SearchProblem, read_problem
from sweeps.search.problem.rig import MountedLidar, ordered
from sweeps.search.problem.search_config import as_plain
from sweeps.search.verification.reevaluation import MOST_REEVALUATED
from tracking.run_folders.search import SearchFolder

FIRST = "_first"
"""Suffix of the name of the first round."""


def first_round(problem: SearchProblem, path: Path, overrides: Sequence[str]) -> SearchProblem:
    """Return the search of the first `search.adapt` trials, without verification."""
    changes: dict[str, Any] = dict.fromkeys(("search.adapt", "robustness", "verify"))
    changes |= {"name": problem.file.name + FIRST, "search.trials": problem.file.search.adapt}
    return read_problem(path, overrides, changes)


def second_round(
    problem: SearchProblem, first: SearchProblem, path: Path, overrides: Sequence[str]
) -> SearchProblem:
    """Return the search from the best rigs of the first, by weights that are trained near these."""
    rigs = SearchFolder.read(first.folder).search.rigs
    names = [name for name, rig in rigs.items() if rig.role == "found"][:MOST_REEVALUATED]
    best = {}
    for name in names:
        lidars = zip(rigs[name].models, rigs[name].zones, rigs[name].placed, strict=True)
        rig = ordered(MountedLidar(model, zone or "", mount) for model, zone, mount in lidars)
        best[ADAPTED + name.removeprefix("found_")] = as_plain(problem.placement_settings(rig))
    assert problem.file.search.adapt is not None
    changes: dict[str, Any] = {
        "search.adapt": None,
        "search.trials": problem.file.search.trials - problem.file.search.adapt,
        "search.families": 0,
        "search.near_start": True,
        "search.start": [*problem.file.search.start, *best],
        "search.objective": [
            objective.model_dump(mode="json", exclude_none=True)
            | ({"evaluator": GENERALIST} if objective.measured else {})
            for objective in problem.file.search.objective
        ],
        "training.checkpoint": str(problem.file.training.checkpoint or "pretrained"),
    }
    changes |= {f"placements.{name}": rig for name, rig in best.items()}
    return read_problem(path, overrides, changes)
