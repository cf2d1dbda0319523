"""Several sweeps as columns that stand side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from lidarplace.configuration.yaml import YamlError, parse_yaml
from lidarplace.rigs.placement import Mount
from tracking.findings.groups import Group, groups
from tracking.findings.paired import with_sums
from tracking.findings.summary import seed_means, surrogates_of
from tracking.run_folders.sweep import RunFolder

NOT_SETTINGS = ("name", "output", "store", "ray", "tracking", "placements", "grid", "exclude")
"""Keys of a configuration that say where and of what a sweep is, not how it was measured."""
SEEN_AXES = ("placement", "seed", "training.seed", "detector")
"""Axes of the grid whose values the page shows anyway."""
_DIGITS = 6


@dataclass(frozen=True)
class Variant:
    """One detector at one setting of one sweep.

    Attributes:
        title: names the sweep, and detector and setting where they tell variants apart.
        means: rows of `seed_means` of the group.
    """

    title: str
    sweep: str
    run: RunFolder
    group: Group
    means: pd.DataFrame

    def surrogates(self, object_class: str) -> pd.DataFrame:
        """Placements as rows, surrogates as columns; "all" is their sum over classes."""
        table = with_sums(self.run.surrogates, self.run.axes)
        return surrogates_of(table, self.group.setting, object_class)


def sweep_names(runs: Sequence[RunFolder]) -> list[str]:
    """Names of the sweeps; those that several share get their folder behind them."""
    count = Counter(run.sweep.name for run in runs)
    return [
        name if count[name] == 1 else f"{name} ({run.path})"
        for run, name in ((run, run.sweep.name) for run in runs)
    ]


def variants(runs: Sequence[RunFolder], names: Sequence[str]) -> list[Variant]:
    """All groups of all sweeps, in their order."""
    found = []
    detectors = {detector for run in runs for detector in run.trials["detector"]}
    for run, name in zip(runs, names, strict=True):
        means = seed_means(run.results, run.axes, run.left_out, run.sweep.judge)
        own = list(groups(run))
        for group in own:
            named = len(own) > 1 or len(detectors) > 1
            title = f"{name} · {group.title}" if named and group.title else name
            found.append(Variant(title, name, run, group, group.of(means)))
    return found


def shared_placements(runs: Sequence[RunFolder]) -> tuple[list[str], list[str]]:
    """Names that at least two sweeps have with the same mounts, and those with other mounts.

    A name of the second list stands for different rigs, so its results are not compared.
    """
    rigs: dict[str, list[list[tuple[float, ...]]]] = {}
    for run in runs:
        for name, mounts in run.placements.items():
            rigs.setdefault(name, []).append(_rig(mounts))
    several = {name: own for name, own in rigs.items() if len(own) > 1}
    same = [name for name, own in several.items() if all(rig == own[0] for rig in own)]
    return same, [name for name in several if name not in same]


def _rig(mounts: Sequence[Mount]) -> list[tuple[float, ...]]:
    return sorted(tuple(round(value, _DIGITS) + 0.0 for value in astuple(m)) for m in mounts)


def differing_settings(runs: Sequence[RunFolder]) -> dict[str, list[str]]:
    """Key paths of the configurations whose values differ, and the value of every sweep.

    An axis of the grid has all its values, under its key path. Keys of `NOT_SETTINGS` and axes of
    `SEEN_AXES` are left out. A sweep that does not name a key has the default, "–".

    Raises:
        ValueError: a configuration is no mapping of YAML.
    """
    flat = [_settings(_configuration(run.path / "config.yaml", run.config)) for run in runs]
    keys = dict.fromkeys(key for own in flat for key in own)
    found = {key: [own.get(key, "–") for own in flat] for key in keys}
    return {key: values for key, values in found.items() if len(set(values)) > 1}


def _configuration(file: Path, text: str) -> Mapping[str, Any]:
    try:
        loaded = parse_yaml(text)
    except YamlError as error:
        raise ValueError(f"{file}: {error}") from None
    if not isinstance(loaded, Mapping):
        raise ValueError(f"{file} must be a mapping of keys, found {type(loaded).__name__}")
    return loaded


def _settings(loaded: Mapping[str, Any]) -> dict[str, str]:
    """Values by key path; an axis of the grid stands instead of the key that it replaces."""
    grid = loaded.get("grid") or {}
    fixed = {key: value for key, value in loaded.items() if key not in NOT_SETTINGS}
    axes = {key: ", ".join(map(str, values)) for key, values in grid.items()}
    return _flat(fixed) | {key: values for key, values in axes.items() if key not in SEEN_AXES}


def _flat(settings: Mapping[str, Any], start: str = "") -> dict[str, str]:
    found: dict[str, str] = {}
    for key, value in settings.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{start}{key}.")
        else:
            found[f"{start}{key}"] = str(value)
    return found
