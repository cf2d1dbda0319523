"""The state of a search, read from its study and its run folder; nothing is run."""

from dataclasses import dataclass
from typing import Any

from lidarplace.pog.surrogates.table import RAY_SURROGATES
from sweeps.results.state import SweepState, sweep_state
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.trials.study import assessment_of, finished_trials, stored_study
from sweeps.search.verification.verify import read_verification
from sweeps.search.verification.winners import best_trials
from sweeps.store.lock import is_locked
from sweeps.store.open import reference, store_of


@dataclass(frozen=True)
class SearchState:
    """The state of a search.

    Attributes:
        alive: whether a driver runs it now.
        trials: wanted, done, feasible (all constraints kept) and failed.
        best: number and objectives by name of the best trial so far, or of the Pareto front; empty
            while none keeps all constraints.
        azimuth_stride: trials took the rays of 1 in so many azimuth steps for the values in `best`;
            1 if all of them, or if no objective counts rays.
        verify: the sweep that trains detectors for the winners; None while it has not begun."""

    name: str
    alive: bool
    trials: dict[str, int]
    best: list[dict[str, Any]]
    azimuth_stride: int
    failures: list[dict[str, Any]]
    verify: SweepState | None


def search_state(problem: SearchProblem) -> SearchState:
    """Return the state of a search from its files.

    Raises ValueError: its journal cannot be read, or the sweep that it left is damaged; OSError:
    its folder cannot be read."""
    settings = problem.file.search
    name = f"{reference(problem.sweep(), 'search')}-{problem.key}"
    study = stored_study(problem.folder, name)
    trials = list(finished_trials(study)) if study else []
    failed = (trial for trial in trials if "failure" in trial.user_attrs)
    failures = [{"trial": trial.number, "reason": trial.user_attrs["failure"]} for trial in failed]
    front = best_trials(study, problem.space) if study else []
    names = [objective.name for objective in settings.objective]
    best = [
        {"trial": trial.number, "values": dict(zip(names, trial.values, strict=True))}
        for trial in (front[:1] if len(names) == 1 else front)
    ]
    counts = {
        "wanted": settings.trials,
        "done": len(trials),
        "feasible": sum(assessment_of(trial).feasible for trial in trials),
        "failed": len(failures),
    }
    alive = is_locked(problem.folder)
    rays = any(objective.by in RAY_SURROGATES for objective in settings.objective)
    stride = settings.azimuth_stride if rays else 1
    return SearchState(problem.file.name, alive, counts, best, stride, failures, _verify(problem))


def _verify(problem: SearchProblem) -> SweepState | None:
    path = problem.folder / "sweep.yaml"
    if problem.file.verify is None or not path.exists():
        return None
    sweep, plan = read_verification(problem)
    if not (sweep.common.output / sweep.common.name).exists():
        return None
    return sweep_state(sweep, plan, store_of(sweep))
