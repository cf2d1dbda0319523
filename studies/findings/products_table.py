"""LiDARs of a stated price: what a rig of them reaches, and what it costs."""

from __future__ import annotations

from functools import cache

from candidates import FOLDER
from predicting import by_own, own_surrogates
from rig_results import SHORT, beside_table, led, number
from scipy import stats

from lidarplace.rigs.catalogue.datasheet import catalogue
from sweeps.configuration.grid import read_sweep
from tracking.findings.best_placement import BestPlacement

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
    best = {target: _best(target) for target in TARGETS}
    rigs = {name: [f"`{name}`: {words}", f"{price(name):,.0f}"] for name, words in WORDS.items()}
    return beside_table(["", "US dollars"], rigs, best, reference, f"`{reference}`")


def price(rig: str) -> float:
    """Of all its LiDARs, US dollars. Raises ValueError if no source states one."""
    prices = [catalogue()[name].price_usd for name in _lidars()[rig]]
    if None in prices:
        raise ValueError(f"products.yaml: {rig} has a LiDAR without a price")
    return sum(filter(None, prices))


def lead(one: str, other: str, target: str) -> str:
    """Own detectors of one rig less those of another, 95 % as in the table."""
    return led(_best(target).differences(other).loc[one])


def seed_sd(target: str) -> str:
    """What a seed adds to all rigs alike, sd in points."""
    return number(_best(target).seed_sd, 1)


def sd(target: str) -> str:
    """What a seed adds to one rig, sd in points."""
    return number(_best(target).sd, 1)


def rho(predictor: str, target: str) -> str:
    """Spearman's, of a predictor with the rigs' own detectors."""
    found, wide = _best(target), own_surrogates("products", SHORT[target])
    values = wide[predictor].loc[found.sure.index]
    return number(stats.spearmanr(values, found.means).statistic)


@cache
def _best(target: str) -> BestPlacement:
    return by_own("products", SHORT[target])


@cache
def _lidars() -> dict[str, list[str]]:
    """By rig, the names of its LiDARs in the catalogue."""
    rigs = read_sweep(FOLDER / "products.yaml").common.placements
    return {name: [mount.lidar.name for mount in rig.mounts] for name, rig in rigs.items()}
