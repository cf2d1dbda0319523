"""How far a rig's worth depends on exact mounts, on every LiDAR, and on the scene."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from statistics import fmean

import numpy as np
import pandas as pd

from lidarplace.mounting.errors import MountingErrors
from sweeps.configuration.search import RobustnessSettings
from sweeps.search.problem.assess import Question
from sweeps.search.problem.choice import Choices, ordered
from sweeps.search.trials.traffic import Pool

AS_DESIGNED = "as designed"


def robustness(
    rigs: Mapping[str, Choices],
    question: Question,
    pool: Pool,
    settings: RobustnessSettings,
    seed: int,
) -> pd.DataFrame:
    """Objectives of each rig as designed, with all mounts off, and with each of its LiDARs dead,
    whatever its constraints: rig, case, objective, draws, value (mean over the draws), worst."""
    cases = [(n, *case) for n, rig in rigs.items() for case in _cases(rig, settings, seed)]
    return _table(cases, question, pool)


def in_scene(
    rigs: Mapping[str, Choices], question: Question, pool: Pool, scene: str
) -> pd.DataFrame:
    """Objectives of each rig on the POG of another scene; columns as of `robustness`."""
    return _table([(name, f"scene: {scene}", [rig]) for name, rig in rigs.items()], question, pool)


def with_share(table: pd.DataFrame) -> pd.DataFrame:
    """The table with `share`: the value by that of the rig as designed; NaN if that is 0."""
    designed = table[table["case"] == AS_DESIGNED].set_index(["rig", "objective"])["value"]
    keys = pd.MultiIndex.from_frame(table[["rig", "objective"]])
    whole = designed.loc[keys].to_numpy()
    share = np.divide(table["value"], whole, out=np.full(len(table), np.nan), where=whole != 0)
    return table.assign(share=share)


def _table(
    cases: Sequence[tuple[str, str, Sequence[Choices]]], question: Question, pool: Pool
) -> pd.DataFrame:
    """Rows of a rig, a case and the rig's draws in it."""
    found = iter(pool.in_order([rig for *_, altered in cases for rig in altered], question))
    rows = []
    for name, case, altered in cases:
        values = [next(found).values or {} for _ in altered]
        for objective in question.objectives:
            own = [each[objective.name] for each in values if objective.name in each]
            worst = (min if objective.best == "maximize" else max)(own, default=math.nan)
            mean = fmean(own) if own else math.nan
            row = {"rig": name, "case": case, "objective": objective.name, "draws": len(own)}
            rows.append(row | {"value": mean, "worst": worst})
    return pd.DataFrame(rows)


def _cases(
    rig: Choices, settings: RobustnessSettings, seed: int
) -> Iterator[tuple[str, list[Choices]]]:
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
