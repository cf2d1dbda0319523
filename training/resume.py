"""Checkpoints of a running training, which resumes after the last epoch.

The randomness of an epoch follows from the seed and the epoch's number, so weights, optimiser and
what was logged are all that has to be kept."""

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from torch import Tensor

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Clouds, JoinedClouds
from lidarplace.logs.boxes import GEOMETRY
from training.checkpoints import DamagedCheckpoint, read_checkpoint, save_checkpoint

LAST = "last.pt"


@dataclass(frozen=True)
class TrainingState:
    """A training at the end of an epoch."""

    epoch: int  # how many are done
    batch_size: int  # frames per step
    batch_size_reduced: bool  # whether these are fewer than there should be
    model: Mapping[str, Tensor]  # state_dict
    optimisation: Mapping[str, Any]  # state_dict of `Optimisation`
    curve: list[tuple[int, str, float]]  # epoch, metric, value of all epochs that are done


@dataclass(frozen=True)
class TrainingFolder:
    """Keeps `last.pt` of one training, all that is needed to go on.

    No best epoch is kept: there is no validation set to choose it by, and the training loss does
    not show overfitting."""

    folder: Path | None  # is made when there is something to keep; None keeps nothing
    fingerprint: str  # of the training, see `fingerprint`

    def load(self) -> TrainingState | None:
        """Read the state of the training; None if it has not begun, or the file is damaged.

        Raises ValueError if it is of another training."""
        if self.folder is None or not (path := self.folder / LAST).exists():
            return None
        try:
            content, _ = read_checkpoint(path)
            file_fingerprint = content.pop("fingerprint")
            state = TrainingState(**content)
        except DamagedCheckpoint as error:
            logging.getLogger(__name__).warning("%s; the training starts again", error)
            return None
        except (ValueError, KeyError, TypeError) as error:
            fault, fix = f"not a checkpoint of a training: {error}", "remove it to start again"
            raise InputError(fault, place=path, fix=fix) from error
        if file_fingerprint != self.fingerprint:
            fault, fix = "other settings, seed or data", "remove it, or use another folder"
            raise InputError(f"of a training with {fault}", place=path, fix=fix)
        return state

    def save(self, state: TrainingState) -> None:
        """Keep the state in place of the one before."""
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        save_checkpoint(self.folder / LAST, vars(state) | {"fingerprint": self.fingerprint})


def fingerprint(settings: Mapping[str, Any], clouds: Clouds, ground_truth: pd.DataFrame) -> str:
    """Hash of what a training depends on: the `repr` of the settings, clouds and objects.

    Clouds count by their frame numbers, their numbers of points and the sizes of their packed
    frames, not by every point."""
    digest = hashlib.sha256(repr(sorted(settings.items())).encode())
    for part in clouds.parts if isinstance(clouds, JoinedClouds) else [clouds]:
        for array in (part.frames, part.counts, part.offsets):
            digest.update(np.ascontiguousarray(array).tobytes())
    table = ground_truth[["frame", "class", *GEOMETRY]]
    digest.update(pd.util.hash_pandas_object(table, index=False).to_numpy().tobytes())
    return digest.hexdigest()
