"""Optuna's study of a search: kept in a file, in batches, resumed at any point.

A batch is suggested as a whole before any of it is evaluated. So the outcome depends on the seed
and the size of a batch, and not on how many workers there are or which was faster."""

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import optuna
from optuna.exceptions import ExperimentalWarning
from optuna.storages import BaseStorage, JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState

from lidarplace.base.errors import InputError
from sweeps.configuration.search import SearchSettings
from sweeps.search.problem.assess import Assessment
from sweeps.search.trials.samplers import Repeatable

ASSESSMENT = "assessment"
"""User attribute of a trial: the assessment of its rig, as JSON."""


@dataclass
class Timing:
    """Seconds of the driver: suggestions, while workers go on; and waiting for evaluations."""

    sampler: float = 0.0
    evaluation: float = 0.0


def storage_in(folder: Path) -> BaseStorage:
    """Open the journal in `folder`, without remains of a killed process: a lock, and half a line.

    Only one process may have it, which the caller has to ensure."""
    path = journal_path(folder)
    path.with_name(path.name + ".lock").unlink(missing_ok=True)
    if path.exists():
        with path.open("rb+") as file:
            file.truncate(file.read().rfind(b"\n") + 1)
    return journal_storage(path)


def journal_storage(path: Path) -> BaseStorage:
    """Open a journal. Raises ValueError that names a damaged one."""
    try:
        return JournalStorage(JournalFileBackend(str(path)))
    except Exception as error:  # what Optuna raises depends on what is wrong in a line
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        fix = "its trials cannot be recovered: remove it to search anew"
        raise InputError(f"cannot be read: {reason}", place=path, fix=fix) from None


def stored_study(folder: Path, name: str) -> optuna.Study | None:
    """Return the study of a search, as far as it has come; None before its first trial.

    None, too, if the stored study is that of another configuration. Raises as `journal_storage`."""
    path = journal_path(folder)
    if not path.exists():
        return None
    storage = journal_storage(path)
    try:
        with quiet():
            return optuna.load_study(study_name=name, storage=storage)
    except KeyError:
        return None


def emptied_journal(folder: Path) -> Path | None:
    """Return the journal of a search that has results in its folder, if it has no trial."""
    path = journal_path(folder)
    is_emptied = not (path.exists() and path.stat().st_size)
    return path if is_emptied and (folder / "search.json").exists() else None


def journal_path(folder: Path) -> Path:
    """Return the file in which a search keeps its trials."""
    return folder / "optuna.journal"


def open_study(
    storage: BaseStorage, name: str, settings: SearchSettings, first: Sequence[Mapping[str, Any]]
) -> optuna.Study:
    """Open the study `name`, new or as it was left. `first`: parameters of the first trials."""
    study = optuna.create_study(
        storage=storage,
        study_name=name,
        directions=[objective.best for objective in settings.objective],
        sampler=Repeatable(settings.sampler, settings.seed, len(first)),
        load_if_exists=True,
    )
    with warnings.catch_warnings(action="ignore", category=ExperimentalWarning):
        study.set_metric_names([objective.name for objective in settings.objective])
    # A stop may have come between two of them.
    for params in first[len(study.get_trials(deepcopy=False)) : settings.trials]:
        study.enqueue_trial(dict(params))
    return study


def tell(
    study: optuna.Study,
    trial: optuna.Trial,
    assessment: Assessment,
    values: Sequence[float] | None,
    failure: str | None = None,
) -> None:
    """Store a trial: constraints, objectives and assessment.

    Without `values` the rig was not measured, or the trial has failed, because of `failure`."""
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        # A trial that was stopped while it was stored has some of this already.
        for name, violation in assessment.sampler_violations.items():
            trial.set_constraint(name, violation)
    trial.set_user_attr(ASSESSMENT, json.dumps(asdict(assessment)))
    if failure is not None:
        trial.set_user_attr("failure", failure)
        study.tell(trial, state=TrialState.FAIL)
    elif values is None:
        study.tell(trial, state=TrialState.PRUNED)
    else:
        study.tell(trial, list(values))


def assessment_of(trial: FrozenTrial) -> Assessment:
    """Return the assessment of a finished trial."""
    return Assessment(**json.loads(trial.user_attrs[ASSESSMENT]))


def finished_trials(study: optuna.Study) -> Iterator[FrozenTrial]:
    """Yield all trials with an assessment, by number."""
    for trial in study.get_trials(deepcopy=False):
        if trial.state.is_finished() and ASSESSMENT in trial.user_attrs:
            yield trial


@contextmanager
def quiet() -> Iterator[None]:
    """Silence Optuna's log of every trial."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)
