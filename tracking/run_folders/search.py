"""Folder of a search, read into one object."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.files.atomic import read_text
from lidarplace.files.regular import is_there
from tracking.run_folders.arrays import Grounds, UnseenMaps
from tracking.run_folders.search_json import Rig, SearchResult
from tracking.run_folders.search_tables import TABLES, TRIALS
from tracking.run_folders.table_schema import Column, DType

_ANGLES = ("roll", "pitch", "yaw")
_OF_LIDAR = re.compile(r"lidar_\d+\.(model|zone|\w+_m|\w+_deg)")


@dataclass(frozen=True)
class SearchFolder:
    """Files that a search left in `path`.

    `search.json` and `trials.parquet` must be there; the others are None or empty when the
    search did not make them. `docs/run_folder.md` describes them."""

    path: Path
    search: SearchResult
    config: str  # text of the configuration, "" if it is not there
    roi: Roi
    trials: pd.DataFrame  # sorted by number
    bound: pd.DataFrame | None
    greedy: pd.DataFrame | None
    robustness: pd.DataFrame | None
    requirements: pd.DataFrame | None
    chosen: pd.DataFrame | None
    verified: pd.DataFrame | None
    # by class, the entropy of each column of voxels, nats, shape (nx, ny)
    pog: dict[str, NDArray[np.float32]]
    unseen: dict[str, dict[str, NDArray[np.float32]]]  # by class and rig, what of it stays unseen
    grounds: Grounds | None

    @property
    def evaluated(self) -> pd.DataFrame:
        """Trials that have a value of every objective."""
        values = [f"value.{objective.name}" for objective in self.search.objectives]
        with_values = (self.trials["state"] == "COMPLETE") & self.trials[values].notna().all(axis=1)
        return self.trials[with_values]

    def rig_of(self, trial: pd.Series) -> Rig | None:
        """Return the rig of a row of `trials`, without exact values; None without a LiDAR."""
        numbers = takewhile(lambda n: pd.notna(trial.get(f"lidar_{n}.model")), count(1))
        lidars = [f"lidar_{n}." for n in numbers]
        if not lidars:
            return None
        positions = [[float(trial[f"{lidar}{axis}_m"]) for axis in "xyz"] for lidar in lidars]
        angles = [[float(trial[f"{lidar}{name}_deg"]) for name in _ANGLES] for lidar in lidars]
        zones = [trial[f"{lidar}zone"] for lidar in lidars]
        searched = {o.name: trial[f"value.{o.name}"] for o in self.search.objectives}
        return Rig(
            role="found",
            mounts=np.hstack([positions, np.radians(angles)]).tolist(),
            models=[trial[f"{lidar}model"] for lidar in lidars],
            zones=[None if pd.isna(zone) else zone or None for zone in zones],
            values={},
            searched=searched,
            measures={},
            feasible=bool(trial["feasible"]),
        )

    @classmethod
    def read(cls, path: Path) -> SearchFolder:
        """Read the run folder `path`.

        Raises ValueError: it is no folder of a search, or a file lacks what it must have."""
        path = Path(path)
        if missing := [n for n in (SearchResult.FILE, TRIALS.file) if not is_there(path / n)]:
            raise InputError(f"not a search's run folder; missing {', '.join(missing)}", place=path)
        search = SearchResult.read(path)
        config = path / "config.yaml"
        maps = UnseenMaps.read(path)
        return cls(
            path=path,
            search=search,
            config=read_text(config) if is_there(config) else "",
            roi=search.roi,
            trials=_trials(search, path).sort_values("number", ignore_index=True),
            **{t.name: t.read_if_there(path) for t in TABLES if t is not TRIALS},
            pog=maps.pog,
            unseen=maps.unseen,
            grounds=Grounds.read(path),
        )


def _trials(search: SearchResult, path: Path) -> pd.DataFrame:
    """Read the table of trials, and check the columns of as many LiDARs as there are, too."""
    trials = search.trials_table.read(path)
    for name in trials.columns:
        if match := _OF_LIDAR.fullmatch(str(name)):
            kind: DType = "str" if match[1] in ("model", "zone") else "float64"
            column = Column(str(name), kind, "of a LiDAR", finite=kind == "float64")
            column.check(trials[name], path / TRIALS.file)
            trials[name] = column.plain(trials[name])
    return trials
