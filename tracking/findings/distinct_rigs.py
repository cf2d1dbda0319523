"""Placements that are one rig under two names."""

from dataclasses import fields, replace
from typing import Any

import pandas as pd

from tracking.run_folders.sweep import RunFolder


def copies(run: RunFolder) -> dict[str, str]:
    """Placements with the mounts and the surrogates of an earlier one -> the earlier one.

    Equal mounts alone may carry different LiDARs, whose surrogates then differ.
    """
    seen: dict[object, str] = {}
    found = {}
    for name, mounts in run.placements.items():
        own = run.surrogates[run.surrogates["placement"] == name].drop(columns=["placement"])
        if own.empty:  # nothing tells its LiDARs
            continue
        values = own.drop(columns=["seconds"], errors="ignore").astype(str)
        same = (mounts, tuple(sorted(values.itertuples(index=False, name=None))))
        first = seen.setdefault(same, name)
        if first != name:
            found[name] = first
    return found


def without(run: RunFolder, names: set[str]) -> RunFolder:
    """The run as if these placements had not been in it.

    Two equal rigs are no two draws of placements: counted twice they would make a correlation look
    surer than it is, and each would keep the other from being the best.
    """
    if not names:
        return run
    gone = set(run.trials.loc[run.trials["placement"].isin(names), "trial"])
    kept: dict[str, Any] = {}
    for field in fields(run):
        table = getattr(run, field.name)
        if isinstance(table, pd.DataFrame):
            if "placement" in table.columns:
                kept[field.name] = table[~table["placement"].isin(names)].reset_index(drop=True)
            elif "trial" in table.columns:
                kept[field.name] = table[~table["trial"].isin(gone)].reset_index(drop=True)
    placements = {name: rig for name, rig in run.placements.items() if name not in names}
    return replace(run, placements=placements, **kept)
