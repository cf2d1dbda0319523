"""How good is the report's decision for a placement, in studies whose truth is known?

    python benchmarks/studies/decision.py               # a table of all cases, then the calibration
    python benchmarks/studies/decision.py --times 200

Seeds scatter with a sd of 1 point around a placement's true AP, and true APs are normal. Of every
study `tracking` names the best placement, says how probable that is, and gives the intervals of its
leads. "Flat prior" is the probability that takes every true AP as equally likely before.

Worlds: "usual" as above; "heavy tails", seeds scatter as Student's t with 3 degrees of freedom, of
sd 1; "unequal", with a sd of 0.5 or 1.3 under one placement or another; "one far below", one
placement 10 points below the others' mean, which stretches the spread that is estimated; "shifted
by 1" and "by 3", each seed adds the same to all placements, with that sd. "Unpaired" is what would
be said if seeds were taken for independent, as before.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from tracking.findings.best_placement import best_placement
from tracking.statistics.all_pairs import AllPairs
from tracking.statistics.posterior import probability_of_best
from tracking.statistics.reliability import Noise, pooled_variance, seed_mean

Array = NDArray[np.float64]
PLACEMENTS = (2, 4, 8, 16)
SEEDS = (1, 2, 3, 5)
SPREADS = (0.0, 0.5, 1.0, 2.0)
"""Sd of the true APs in points; 0: all are equal."""

SHIFTS = {"shifted by 1": 1.0, "shifted by 3": 3.0}
WORLDS = ("usual", "heavy tails", "unequal", "one far below", *SHIFTS)
BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0)
DRAWS = 2_000
"""From a posterior: ten times fewer than the report's, whose error averages out over studies."""


@dataclass(frozen=True)
class Case:
    """Studies of one kind; `spread` in points."""

    world: str
    placements: int
    seeds: int
    spread: float


def study(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """True AP, shape (placements,), and what was measured, shape (placements, seeds); points."""
    size = case.placements, case.seeds
    truth = 80 + case.spread * rng.standard_normal(case.placements)
    noise = rng.standard_normal(size)
    if case.world == "heavy tails":
        noise = rng.standard_t(3, size) / np.sqrt(3)
    elif case.world == "unequal":
        noise *= rng.choice([0.5, 1.3], (case.placements, 1))
    elif case.world == "one far below":
        truth[0] -= 10
    shift = SHIFTS.get(case.world, 0.0) * rng.standard_normal(case.seeds)
    return truth, truth[:, None] + noise + shift


def flat_prior(means: Array, seeds: int, variance: float, degrees: int, seed: int) -> Array:
    """Probability of each placement to be the best with flat priors, shape (n,)."""
    rng = np.random.default_rng(seed)
    sd = np.sqrt(degrees * variance / seeds / rng.chisquare(degrees, (DRAWS, 1)))
    drawn = means + sd * rng.standard_normal((DRAWS, len(means)))
    return np.bincount(drawn.argmax(axis=1), minlength=len(means)) / DRAWS


def decide(truth: Array, y: Array, seed: int) -> dict[str, float]:
    """What `tracking` says of a study, and whether it is so."""
    order = np.argsort(-seed_mean(y), kind="stable")
    truth, y = truth[order], y[order]
    means, noise = seed_mean(y), Noise.of(y)
    best = truth == truth.max()
    found = {"right": 1 / best.sum() if best[0] else 0.0, "regret": float(truth.max() - truth[0])}
    if noise.degrees == 0:
        return found
    variance, degrees = pooled_variance(y)
    unpaired = Noise(noise.counts, float(variance), float(degrees))
    low, high = AllPairs.of(means, noise).intervals(0)[1:].T
    lead = truth[0] - truth[1:]
    said, before = (probability_of_best(means, n, seed, DRAWS)[0] for n in (noise, unpaired))
    flat = flat_prior(means, y.shape[1], noise.variance, int(noise.degrees), seed)
    return {
        **found,
        "said": said,
        "said before": before,
        "flat": flat[0],
        "covered": float(((low <= lead) & (lead <= high)).all()),
        "all pairs": all_pairs_held(means, noise, truth),
        "all pairs before": all_pairs_held(means, unpaired, truth),
        "overstated": float(means[0] - means[1] - lead[0]),
        "told apart": float((low > 0).all()),
        "wrongly": float(((low > 0) & (lead <= 0)).any()),
    }


def all_pairs_held(means: Array, noise: Noise, truth: Array) -> float:
    """Whether the intervals of all pairs hold the true differences: 1 or 0."""
    pairs = AllPairs.of(means, noise)
    for at in range(len(means)):
        low, high = np.delete(pairs.intervals(at), at, axis=0).T
        lead = truth[at] - np.delete(truth, at)
        if not ((low <= lead) & (lead <= high)).all():
            return 0.0
    return 1.0


def check_against_report(y: Array) -> None:
    """`decide` must say what `best_placement` says of the same results."""
    n, seeds = y.shape
    table = pd.DataFrame(
        {
            "placement": np.repeat(np.arange(n), seeds),
            "seed": np.tile(np.arange(seeds), n),
            "value": y.ravel(),
        }
    )
    best = best_placement(table)
    assert best is not None
    means = -np.sort(-seed_mean(y))
    noise = Noise.of(y)
    assert int(best.best) == int(seed_mean(y).argmax())
    expected = AllPairs.of(means, noise).intervals(0)[1:]
    assert np.allclose(best.others[["low", "high"]], expected, equal_nan=True)
    assert np.allclose(best.sure, probability_of_best(means, noise), equal_nan=True)


def cases() -> list[Case]:
    return [
        Case(world, n, seeds, spread)
        for world in WORLDS
        for n in PLACEMENTS
        for seeds in SEEDS
        for spread in (SPREADS if world != "one far below" else (1.0,))
        if seeds > 1 or world == "usual"
    ]


def calibration(said: pd.Series, right: pd.Series) -> pd.DataFrame:
    """Said against happened, in percent, a row a bin of what was said."""
    bins = pd.cut(said, BINS, include_lowest=True, labels=_bin_names())
    table = pd.DataFrame({"said": said, "happened": right}).groupby(bins, observed=True)
    return (100 * table.mean()).assign(studies=table.size()).rename_axis("bin")


def _bin_names() -> list[str]:
    return [f"{100 * a:.0f} – {100 * b:.0f} %" for a, b in pairwise(BINS)]


def _markdown(table: pd.DataFrame, formats: dict[str, str]) -> str:
    """A Markdown table with an empty cell for NaN."""
    lines = ["| " + " | ".join(map(str, table)) + " |", "|---" * table.shape[1] + "|"]
    for row in table.to_dict("records"):
        cells = (
            "" if pd.isna(value) else format(value, formats.get(str(name), ""))
            for name, value in row.items()
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def summary(case: Case, studies: pd.DataFrame) -> dict[str, object]:
    """A row of the table of all cases."""
    mean = studies.mean()
    percents = {
        "named is best": "right",
        "said": "said",
        "said, unpaired": "said before",
        "said, flat prior": "flat",
        "leads covered": "covered",
        "all pairs covered": "all pairs",
        "all pairs, unpaired": "all pairs before",
        "told from all": "told apart",
        "told wrongly": "wrongly",
    }
    return {
        "world": case.world,
        "placements": case.placements,
        "seeds": case.seeds,
        "spread": case.spread,
        "regret": mean["regret"],
        "lead too large by": mean.get("overstated", np.nan),
        **{shown: 100 * mean.get(name, np.nan) for shown, name in percents.items()},
    }


def main(times: Annotated[int, typer.Option(min=2, help="studies of a case")] = 1000) -> None:
    rng, rows, every = np.random.default_rng(0), [], []
    for case in cases():
        found = []
        for i in range(times):
            truth, y = study(case, rng)
            if i == 0:
                check_against_report(y)
            found.append(decide(truth, y, i))
        studies = pd.DataFrame(found)
        rows.append(summary(case, studies))
        every.append(studies.assign(world=case.world, seeds=case.seeds, spread=case.spread))
    error = 100 * np.sqrt(0.05 * 0.95 / times)
    print(f"{times} studies of a case: the standard error of 95 % is {error:.1f} points")
    points = {"regret": ".2f", "lead too large by": ".2f"}
    shown = pd.DataFrame(rows)
    print(_markdown(shown, dict.fromkeys(shown.columns[6:], ".0f") | points))
    told = pd.concat(every, ignore_index=True).dropna(subset="said")
    told["differ"] = np.where(told["spread"] > 0, "differ", "all equal")
    every_spread = told.assign(differ="of any spread")
    both = pd.concat([told, every_spread], ignore_index=True)
    for (world, differ), part in both.groupby(["world", "differ"], sort=False):
        for name, method in (
            ("flat", "flat prior"),
            ("said before", "unpaired"),
            ("said", "in use"),
        ):
            print(f"\nCalibration, {world}, placements {differ}, {method}; percent")
            table = calibration(part[name], part["right"]).reset_index()
            print(_markdown(table, {"said": ".0f", "happened": ".0f"}))


if __name__ == "__main__":
    typer.run(main)
