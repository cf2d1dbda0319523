"""Folder of a sweep, read into one object."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.base.metrics import METRICS
from lidarplace.base.roi import Roi
from lidarplace.command_line.invocation import command
from lidarplace.files.atomic import read_text
from lidarplace.files.columns import check_columns
from lidarplace.files.regular import is_there
from lidarplace.pog.surrogates.table import SURROGATES as KNOWN
from lidarplace.rigs.placement import Mount
from tracking.run_folders.arrays import FailureFrames, Frame, Grounds, Maps
from tracking.run_folders.search_json import SearchResult
from tracking.run_folders.sweep_json import SweepResult
from tracking.run_folders.sweep_tables import RESULTS, SURROGATES, TABLES, TRIALS

_LOCK = ".lock"
"""Name of the file that a sweep writes at its start; it writes the others at its end."""


@dataclass(frozen=True)
class RunFolder:
    """Files that a sweep left in `path`.

    `config.yaml`, `sweep.json` and the needed tables must be there; what the sweep did not make
    is None. A sweep of surrogates alone has no results, and trials whose detector is ""."""

    path: Path
    config: str  # text of the resolved configuration
    sweep: SweepResult
    roi: Roi
    placements: dict[str, tuple[Mount, ...]]  # mounts by the placement's name
    axes: tuple[str, ...]  # further axes of the grid, columns of `results` and `trials`
    results: pd.DataFrame
    surrogates: pd.DataFrame
    trials: pd.DataFrame
    curves: pd.DataFrame | None
    pr_curves: pd.DataFrame | None
    distance: pd.DataFrame | None
    sector: pd.DataFrame | None
    left_out: pd.DataFrame | None
    points: pd.DataFrame | None
    individuals: pd.DataFrame | None
    accuracy: pd.DataFrame | None
    sampling_error: pd.DataFrame | None
    pog_resamples: pd.DataFrame | None
    tasks: pd.DataFrame | None
    promotions: pd.DataFrame | None
    objects: pd.DataFrame | None
    found: pd.DataFrame | None
    requirements: pd.DataFrame | None
    maps: Maps | None
    frame: Frame | None
    failures: FailureFrames | None
    grounds: Grounds | None

    @property
    def classes(self) -> tuple[str, ...]:
        """Object classes in the order of the configuration."""
        return self.sweep.classes

    @classmethod
    def read(cls, path: Path) -> RunFolder:
        """Read the run folder `path`.

        Raises ValueError: it is not a run folder, its sweep has not finished, or a file is missing
        or lacks what it must have."""
        path = Path(path)
        needed = [table.file for table in TABLES if table.needed]
        required = ["config.yaml", SweepResult.FILE, *needed]
        missing = [name for name in required if not is_there(path / name)]
        if missing == required and (path / _LOCK).is_file():
            fix = f"{command('status', 'FILE')} shows its progress, FILE being its configuration"
            raise InputError("no results yet, its sweep has not finished", place=path, fix=fix)
        if SweepResult.FILE in missing and is_there(path / SearchResult.FILE):
            raise InputError("the folder of a search", expected="that of a sweep", place=path)
        if missing:
            raise InputError(f"not a run folder; missing {', '.join(missing)}", place=path)
        sweep = SweepResult.read(path)
        trials = TRIALS.read(path)
        # An axis over placements, detectors or seeds is one of the fixed columns already.
        fixed = {column.name for column in RESULTS.columns}
        axes = tuple(a for a in sweep.axes if a in trials.columns and a not in fixed)
        others = [table for table in TABLES if table is not TRIALS]
        tables: dict[str, Any] = {t.name: t.read_if_there(path, axes) for t in others}
        tables[TRIALS.name] = trials
        for table in (SURROGATES, TRIALS):
            names = tables[table.name]["placement"]
            unknown = names[~names.isin(sweep.placements)]
            if len(unknown):
                fault, key = f"missing, but named in {table.file}", f"placements.{unknown.iloc[0]}"
                raise InputError(fault, place=path / sweep.FILE, key=key)
        # Names of plug-ins are known from here on, as those of ours are.
        for name in tables[SURROGATES.name]["surrogate"].unique():
            KNOWN.get(str(name))
        for name in tables[RESULTS.name]["metric"].unique():
            METRICS.get(str(name))
        check_columns(list(tables[RESULTS.name].columns), axes, str(path / RESULTS.file))
        return cls(
            path=path,
            config=read_text(path / "config.yaml"),
            sweep=sweep,
            roi=sweep.roi,
            placements=sweep.rigs,
            axes=axes,
            **tables,
            maps=Maps.read(path),
            frame=Frame.read(path),
            failures=FailureFrames.read(path),
            grounds=Grounds.read(path),
        )
