"""Do the report's intervals hold the AP of all traffic when the test frames met few individuals?

    python benchmarks/studies/individuals_coverage.py               # all cases
    python benchmarks/studies/individuals_coverage.py --times 20

Test sets are drawn from traffic whose AP is known from 1,000 routes: on every route about 8.5 road
users, each in as many frames as a lognormal number says (a tenth of them in half of the frames or
more), so that ten of the 34 of four routes have about 70 % of the boxes. How well an individual is
seen is its own, and partly its own under each placement, under the last three times as much as
under the first; with an effect of the routes these differ in that too, in traffic and in false
alarms. Boxes of a frame scatter around it. Every placement is trained with three seeds, which shift
all of its scores, and those of each individual. AP, the jackknife and the intervals are those in
use. "Seeds" leaves the choice of the test objects out; "pooled" compares AP_R40 with one variance
for all pairs, as before.

Percent of the intervals that hold the truth, and half their width in points: of a placement's mean,
and of the difference of two; percent of the studies in which the intervals of all pairs do, in
which the named best is said to be the best, and is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from tracking.findings.best_placement import best_placement
from tracking.findings.summary import seed_means
from tracking.statistics.all_pairs import AllPairs
from tracking.statistics.jackknife import NOTHING, sample_error
from tracking.statistics.reliability import Noise
from training.matches import Matches

Array = NDArray[np.float64]
PLACEMENTS, SEEDS = 4, 3
QUALITY = np.array([0.0, 0.1, 0.2, 0.3])
"""Of the placements, in standard deviations of what individuals differ in."""
OWN = 0.3 * np.array([0.5, 0.8, 1.2, 1.5])
"""Of what individuals and routes are under each placement alone, in the same unit."""
ROUTES = (3, 4, 8, 16)
EFFECTS = {"none": 0.0, "some": 0.3, "much": 0.6}
"""Of the routes, in the same unit."""
POPULATION = 1000


@dataclass(frozen=True)
class TestSet:
    """Scores of one test set. Hits and detections are by placement and seed.

    Attributes:
        individual, route: of every ground truth, shape (G,).
        individuals, routes: how many.
        matches: what was found, by placement, seed.
        owner, on: the individual (or beyond them, the route) and route of each detection.
    """

    individual: NDArray[np.intp]
    route: NDArray[np.intp]
    individuals: int
    routes: int
    matches: list[list[Matches]]
    owner: list[list[NDArray[np.intp]]]
    on: list[list[NDArray[np.intp]]]


def draw(routes: int, effect: float, luck: Array, rng: np.random.Generator) -> TestSet:
    """A test set; `luck` of each training, shape (placements, seeds)."""
    seeds = luck.shape[1]
    met = np.maximum(rng.poisson(8.5 * np.exp(2 * effect * rng.standard_normal(routes) * 0.4)), 1)
    route_of = np.repeat(np.arange(routes), met)
    n = len(route_of)
    frames = np.clip(np.ceil(np.exp(2.2 + 1.3 * rng.standard_normal(n))), 1, 200).astype(int)
    individual = np.repeat(np.arange(n), frames)
    route = route_of[individual]
    size = len(individual)
    seen = (
        0.8
        + QUALITY[:, None]
        + rng.standard_normal(n)[individual]
        + OWN[:, None] * rng.standard_normal((PLACEMENTS, n))[:, individual]
        + effect * rng.standard_normal(routes)[route]
        + OWN[:, None] * effect * rng.standard_normal((PLACEMENTS, routes))[:, route]
        + 0.8 * rng.standard_normal(size)
    )
    alarms = (
        0.5 * np.bincount(route, minlength=routes) * np.exp(effect * rng.standard_normal(routes))
    )
    matches, owner, on = [], [], []
    for p in range(PLACEMENTS):
        rows: tuple[list[Matches], list[NDArray[np.intp]], list[NDArray[np.intp]]] = ([], [], [])
        for s in range(seeds):
            value = seen[p] + luck[p, s] + 0.3 * rng.standard_normal(n)[individual]
            value += 0.5 * rng.standard_normal(size)
            score = _sigmoid(value + 0.5 * rng.standard_normal(size))
            hit = np.where(value > 0, score, np.nan)
            boxed = (value > 0) | (rng.random(size) < 0.5)  # half of the missed have a bad box
            where = np.repeat(np.arange(routes), rng.poisson(alarms))
            false = _sigmoid(0.3 * QUALITY[p] - 0.7 + rng.standard_normal(len(where)))
            rows[0].append(Matches(hit, hit, np.concatenate([score[boxed], false])))
            rows[1].append(np.concatenate([individual[boxed], n + where]))
            rows[2].append(np.concatenate([route[boxed], where]))
        for table, row in zip((matches, owner, on), rows, strict=True):
            table.append(row)
    return TestSet(individual, route, n, routes, matches, owner, on)


def _sigmoid(x: Array) -> Array:
    return 1 / (1 + np.exp(-x))


def trainings(seeds: int, rng: np.random.Generator) -> Array:
    return 0.15 * rng.standard_normal((PLACEMENTS, seeds))


def whole_ap(matches: Matches) -> float:
    """AP of all of it: without a unit that nothing belongs to."""
    truths, found = (np.zeros(len(side), np.intp) for side in (matches.hit, matches.scores))
    return float(matches.ap_without_each(truths, found, 2)[1])


def tables(test: TestSet) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Results and left-out values, as a run folder has them."""
    kinds = (
        ("route", test.routes, test.route, test.on),
        ("individual", test.individuals + test.routes, test.individual, test.owner),
    )
    results, left_out = [], []
    for p, row in enumerate(test.matches):
        for s, matches in enumerate(row):
            results.append((p, s, whole_ap(matches)))
            for kind, units, truth, detection in kinds:
                values = matches.area_without_each(truth, detection[p][s], units)
                own = {"unit": kind, "left_out": np.arange(units), "value": values}
                own["ground_truths"] = np.bincount(truth, minlength=units)
                left_out.append(pd.DataFrame({"placement": p, "seed": s} | own))
            none = (np.full(len(side), -1) for side in (matches.hit, matches.scores))
            area = matches.area_without_each(*none, 1)
            own = {"unit": NOTHING, "left_out": "", "value": area, "ground_truths": 0}
            left_out.append(pd.DataFrame({"placement": p, "seed": s} | own))
    fixed = {"class": "Car", "detector": "d", "metric": "AP_R40_3D", "iou": 0.7}
    table = pd.DataFrame(results, columns=["placement", "seed", "value"])
    table = table.assign(**fixed, difficulty="all", ground_truths=len(test.route))
    return table, pd.concat(left_out, ignore_index=True).assign(**fixed)


def judge(results: pd.DataFrame, left_out: pd.DataFrame | None, truth: Array) -> dict[str, float]:
    """What the report says of a study, and whether it is so."""
    means = seed_means(results, left_out=left_out).set_index("placement").loc[range(PLACEMENTS)]
    mean, half = means["mean"].to_numpy(), means["half"].to_numpy()
    one, other = np.triu_indices(PLACEMENTS, 1)
    off = (mean[one] - mean[other]) - (truth[one] - truth[other])
    best = best_placement(results, left_out=left_out)
    assert best is not None
    ranked = truth[best.sure.index.to_numpy()]
    return {
        "mean": float(((means["low"] <= truth) & (truth <= means["high"])).mean()),
        "mean half": float((means["high"] - means["low"]).mean() / 2),
        "difference": float((np.abs(off) <= np.hypot(half[one], half[other])).mean()),
        "difference half": float(np.hypot(half, half).mean()),
        "pairs": held(best.pairs, ranked),
        "said": float(best.sure.iloc[0]),
        "right": float(ranked[0] == truth.max()),
    }


def held(pairs: AllPairs, truth: Array) -> float:
    """Whether the intervals of all pairs hold the true differences: 1 or 0."""
    bounds = np.stack([pairs.intervals(at) for at in range(PLACEMENTS)])
    lead = np.subtract.outer(truth, truth)
    inside = (bounds[..., 0] <= lead) & (lead <= bounds[..., 1])
    return float(inside[~np.eye(PLACEMENTS, dtype=bool)].all())


def pooled(results: pd.DataFrame, left_out: pd.DataFrame, truth: Array) -> float:
    """`held` of AP_R40 with one variance of the test objects for all pairs, and unpaired seeds."""
    y = results.pivot(index="placement", columns="seed", values="value").to_numpy()
    error = sample_error(left_out, paired=True)
    noise = Noise.of_each(y)
    degrees = PLACEMENTS * (SEEDS - 1)
    alike = None if error is None else replace(error, units=0.0)
    return held(AllPairs.of(y.mean(axis=1), replace(noise, degrees=degrees), alike), truth)


def population(effect: float) -> Array:
    """AP of every placement in all traffic, shape (placements,)."""
    rng = np.random.default_rng(1)
    test = draw(POPULATION, effect, trainings(10, rng), rng)
    return np.array([np.mean([whole_ap(matches) for matches in row]) for row in test.matches])


def _case(effect: float, routes: int, times: int, truth: Array) -> tuple[str, ...]:
    """Cells of a row."""
    rng, found, individuals, before = np.random.default_rng(routes), [], [], []
    for _ in range(times):
        test = draw(routes, effect, trainings(SEEDS, rng), rng)
        results, left_out = tables(test)
        individuals.append(test.individuals)
        found.append([judge(results, table, truth) for table in (None, left_out)])
        before.append(pooled(results, left_out, truth))
    old, new = (pd.DataFrame(rows).mean() for rows in zip(*found, strict=True))
    cells = [f"{np.mean(individuals):.0f}"]
    for name in ("mean", "difference"):
        cells += [f"{100 * side[name]:.0f} (± {side[f'{name} half']:.1f})" for side in (old, new)]
    cells += [f"{100 * value:.0f}" for value in (old["pairs"], np.mean(before), new["pairs"])]
    cells += [f"{100 * side['said']:.0f}" for side in (old, new)]
    return (*cells, f"{100 * new['right']:.0f}")


def main(times: Annotated[int, typer.Option(min=2, help="studies of a case")] = 200) -> None:
    error = 100 * np.sqrt(0.05 * 0.95 / times)
    print(f"{times} studies of a case: the standard error of 95 % is at most {error:.1f} points")
    head = ["routes differ", "routes", "individuals"]
    head += [f"{what}, {how}" for what in ("mean", "difference") for how in ("seeds", "in use")]
    head += [f"all pairs, {how}" for how in ("seeds", "pooled", "in use")]
    head += ["said, seeds", "said, in use", "right"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for name, effect in EFFECTS.items():
        truth = population(effect)
        for routes in ROUTES:
            cells = (name, str(routes), *_case(effect, routes, times, truth))
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    typer.run(main)
