"""Do rigs keep their order with another network, in other scenes, after other trainings?"""

from __future__ import annotations

from functools import cache
from itertools import combinations

import pandas as pd
from distil import OTHER_SCENES
from predicting import (
    GENERALIST,
    PREDICTORS,
    equal_budget,
    every_predictor,
    of,
    own_detectors,
    own_surrogates,
    read,
)
from rig_results import SHORT, head_of, label, number, table
from scipy import stats

TARGETS = ("car", "recall")
COLLAPSED = "optimum_m_sog"
"""The rig that every evaluator puts last: with it all agree."""
WAYS = {
    GENERALIST: "generalists, three seeds",
    "finetuned": "fine-tuned from a generalist, two seeds",
    "longer": "own detectors, trained three times as long, one seed",
    "second": "a generalist of `second_tiny`",
    "second_own": "own detectors of `second_tiny`, one seed",
    "sparse": "a generalist in half the traffic",
    "carla": "a generalist on CARLA's maps",
}
"""How rigs were judged."""
_HERE = {
    GENERALIST: "as above",
    "second": "`second_tiny`",
    "second_own": "own `second_tiny`",
    "sparse": "half the traffic",
    "carla": "CARLA's maps",
}
"""Judges of all these rigs; generalists where it is not said otherwise."""


def order_table() -> str:
    """Spearman's rho of each way with the rigs' own detectors, of two of its seeds with each
    other, and what it gives more than own detectors, points.

    First, of one seed of own detectors with the mean of the others, mean over seeds.
    """
    heads = ["", "rigs"]
    for target in TARGETS:
        heads += [f"{head_of(target)}: ρ", "two seeds agree", "more than own"]
    rows = [["own detectors, one seed", str(len(_own(TARGETS[0])))]]
    for target in TARGETS:
        rows[0] += [seed_with_others(target), seeds_agree("own", target), "–"]
    for way, words in WAYS.items():
        cells = [words, str(len(_shared(way, TARGETS[0])))]
        for target in TARGETS:
            level = "–" if way in OTHER_SCENES else more(way, target)
            cells += [rho(way, target), seeds_agree(way, target), level]
        rows.append(cells)
    return table(heads, rows)


def value(way: str, rig: str, target: str) -> str:
    """What a way gives a rig, mean over seeds, percent."""
    return number(float(_seeds(way, target).loc[rig].mean()), 1)


def spread(way: str, target: str) -> str:
    """Between the best and the worst of the rigs that `order_table` compares, points."""
    given = _shared(way, target)[way]
    return number(float(given.max() - given.min()), 1)


def seeds_agree(way: str, target: str) -> str:
    """Spearman's rho of two seeds, mean over pairs; a dash for one seed."""
    seeds = _own(target) if way == "own" else _seeds(way, target).reindex(_own(target).index)
    pairs = [seeds[list(pair)].dropna() for pair in combinations(seeds.columns, 2)]
    found = [stats.spearmanr(pair.iloc[:, 0], pair.iloc[:, 1]).statistic for pair in pairs]
    return number(sum(found) / len(found)) if found else "–"


def rho(way: str, target: str) -> str:
    """Spearman's, over the rigs with the same LiDARs that were judged in that way."""
    both = _shared(way, target)
    return number(stats.spearmanr(both[way], both["mean"]).statistic)


def agree(one: str, other: str, target: str) -> str:
    """Spearman's rho of two ways, over all rigs that both judged."""
    both = [_seeds(way, target).mean(axis=1) for way in (one, other)]
    found = pd.concat(both, axis=1, join="inner")
    return number(stats.spearmanr(found.iloc[:, 0], found.iloc[:, 1]).statistic)


def seed_with_others(target: str) -> str:
    """Spearman's rho of one seed of own detectors with the mean of the others, mean over seeds."""
    seeds = _own(target)
    found = [
        stats.spearmanr(seeds[seed], seeds.drop(columns=seed).mean(axis=1)).statistic
        for seed in seeds.columns
    ]
    return number(sum(found) / len(found))


def more(way: str, target: str) -> str:
    """What a way gives more than own detectors, mean over rigs, points."""
    both = _shared(way, target)
    return number(float((both[way] - both["mean"]).mean()), 1, sign=True)


def predicted_table() -> str:
    """Spearman's rho of each predictor, in its scene, with what generalists give there."""
    heads = [""]
    heads += [f"{head_of(target)}, {words}" for target in TARGETS for words in _HERE.values()]
    rows = []
    for name in PREDICTORS:
        if name not in (GENERALIST, "expected_ig, occluded"):
            cells = [predicted(name, way, target) for target in TARGETS for way in _HERE]
            rows.append([label(name), *cells])
    return table(heads, rows)


def predicted(name: str, way: str, target: str) -> str:
    """Spearman's rho of a predictor with a way, over the rigs of `order_table`."""
    judged = _shared(way, target)[way]
    wide = every_predictor(SHORT[target])
    if way in OTHER_SCENES and name != "mean height":
        wide = own_surrogates(way, SHORT[target])
    if name not in wide.columns:
        return "–"
    return number(stats.spearmanr(wide[name].loc[judged.index], judged).statistic)


@cache
def _shared(way: str, target: str) -> pd.DataFrame:
    """A way and the mean of own detectors, by rig."""
    found = _seeds(way, target).mean(axis=1)
    return pd.DataFrame({way: found, "mean": _own(target).mean(axis=1)}).dropna()


def _seeds(way: str, target: str) -> pd.DataFrame:
    """What a way gives, a row a rig and a column a seed."""
    main = read("main_results")
    rows = main[main["evaluator"] == GENERALIST] if way == GENERALIST else read(f"{way}_results")
    return of(rows, SHORT[target]).pivot(index="placement", columns="seed", values="value")


def _own(target: str) -> pd.DataFrame:
    """Own detectors, a row a rig and a column a seed."""
    own = of(own_detectors(), SHORT[target])
    rigs = equal_budget([str(one) for one in own["placement"].unique()])
    rigs.remove(COLLAPSED)
    return own.pivot(index="placement", columns="seed", values="value").loc[rigs]
