"""Robustness of rigs: to mounts that are off, to dead LiDARs, and to other scenes."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from statistics import fmean

import numpy as np
import pandas as pd

from lidarplace.mounting.errors import MountingErrors
from sweeps.configuration.search import RobustnessSettings
from sweeps.search.problem.assess import Criteria
from sweeps.search.problem.rig import Rig, ordered
from sweeps.search.trials.traffic import Pool

AS_DESIGNED = "as designed"


def robustness(
    rigs: Mapping[str, Rig], criteria: Criteria, pool: Pool, settings: RobustnessSettings, seed: int
) -> pd.DataFrame:
    """Compute objectives of each rig as designed, with all mounts off, and with each LiDAR dead.

    Constraints are ignored. Columns: rig, case, objective, draws, value (mean over the draws),
    worst."""
    cases = [(n, *case) for n, rig in rigs.items() for case in _cases(rig, settings, seed)]
    return _table(cases, criteria, pool)


def in_scene(rigs: Mapping[str, Rig], criteria: Criteria, pool: Pool, scene: str) -> pd.DataFrame:
    """Compute objectives of each rig on the POG of another scene; columns as of `robustness`."""
    return _table([(name, f"scene: {scene}", [rig]) for name, rig in rigs.items()], criteria, pool)


def with_share(table: pd.DataFrame) -> pd.DataFrame:
    """Add the column `share`: the value by that of the rig as designed; NaN if that is 0."""
    designed = table[table["case"] == AS_DESIGNED].set_index(["rig", "objective"])["value"]
    keys = pd.MultiIndex.from_frame(table[["rig", "objective"]])
    whole = designed.loc[keys].to_numpy()
    share = np.divide(table["value"], whole, out=np.full(len(table), np.nan), where=whole != 0)
    return table.assign(share=share)


def _table(
    cases: Sequence[tuple[str, str, Sequence[Rig]]], criteria: Criteria, pool: Pool
) -> pd.DataFrame:
    """Return rows of a rig, a case and the rig's draws in it."""
    assessments = iter(pool.in_order([rig for *_, altered in cases for rig in altered], criteria))
    rows = []
    for rig, case, altered in cases:
        values = [next(assessments).values or {} for _ in altered]
        for objective in criteria.objectives:
            name = objective.name
            draws = [by_name[name] for by_name in values if name in by_name]
            worst = (min if objective.best == "maximize" else max)(draws, default=math.nan)
            mean = fmean(draws) if draws else math.nan
            row = {"rig": rig, "case": case, "objective": name, "draws": len(draws)}
            rows.append(row | {"value": mean, "worst": worst})
    return pd.DataFrame(rows)


def _cases(rig: Rig, settings: RobustnessSettings, seed: int) -> Iterator[tuple[str, list[Rig]]]:
    yield AS_DESIGNED, [rig]
    if errors := MountingErrors(settings.offset, math.radians(settings.angle_deg)):
        random = np.random.default_rng(seed)
        displaced = (
            ordered(replace(c, mount=errors.displaced(c.mount, random)) for c in rig)
            for _ in range(settings.draws)
        )
        yield "mounts off", list(displaced)
    for i, dead in enumerate(rig if len(rig) > 1 else ()):
        yield f"LiDAR {i + 1} fails", [(*rig[:i], replace(dead, dead=True), *rig[i + 1 :])]
