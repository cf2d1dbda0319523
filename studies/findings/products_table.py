"""LiDARs of a stated price: what a rig of them reaches, and what it costs."""

from __future__ import annotations

from functools import cache

import pandas as pd
from candidates import FOLDER
from judged import SHORT, beside, heads_beside, led, number, table
from predicting import by_own, of, read
from scipy import stats

from lidarplace.catalogue.datasheet import catalogue
from sweeps.configuration.grid import read_sweep
from tracking.findings.best_placement import BestPlacement
from tracking.findings.paired import with_sums
from tracking.findings.summary import surrogates_of

TARGETS = ("car", "recall")
WORDS = {
    "one_vlp16": "one `vlp16`",
    "two_vlp16": "two",
    "three_vlp16": "three",
    "four_vlp16": "four",
    "four_vlp16_level": "four, level",
    "one_os1_64": "one `os1_64_gen1`",
    "two_os1_64": "two",
    "os1_64_and_two_vlp16": "one, and two `vlp16` rolled outwards",
}


def products_table(reference: str) -> str:
    """What the rigs' own detectors reach, with 95 % of the difference to `reference`.

    For all pairs of these rigs at once.
    """
    leads = {target: _best(target).differences(reference) for target in TARGETS}
    means = {target: _means(target) for target in TARGETS}
    rows = [
        [f"`{name}`: {words}", f"{price(name):,.0f}", *beside(name, reference, means, leads)]
        for name, words in WORDS.items()
    ]
    return table(["", "US dollars", *heads_beside(TARGETS, f"`{reference}`")], rows)


def price(rig: str) -> float:
    """Of all its LiDARs, US dollars."""
    return sum(catalogue()[name].price_usd or 0 for name in _lidars()[rig])


def lead(one: str, other: str, target: str) -> str:
    """Own detectors of one rig less those of another, 95 % as in the table."""
    return led(_best(target).differences(other).loc[one])


def rho(predictor: str, target: str) -> str:
    """Spearman's, of a predictor with the rigs' own detectors."""
    wide = surrogates_of(with_sums(read("products_surrogates")), {}, SHORT[target][0])
    means = _means(target)
    return number(stats.spearmanr(wide[predictor].loc[means.index], means).statistic)


def _means(target: str) -> pd.Series:
    return of(read("products_results"), SHORT[target]).groupby("placement")["value"].mean()


@cache
def _best(target: str) -> BestPlacement:
    return by_own("products", SHORT[target])


@cache
def _lidars() -> dict[str, list[str]]:
    """By rig, the names of its LiDARs in the catalogue."""
    rigs = read_sweep(FOLDER / "products.yaml").common.placements
    return {name: [mount.lidar.name for mount in rig.mounts] for name, rig in rigs.items()}
