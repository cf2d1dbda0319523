"""Do the report's intervals hold the AP of all traffic when the test frames met few individuals?

    python benchmarks/studies/individuals_coverage.py               # all cases
    python benchmarks/studies/individuals_coverage.py --times 20
    python benchmarks/studies/individuals_coverage.py --recall       # of recall, near 100 %

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

`--recall`: recall of known truth, of two placements and three seeds, on routes that do not differ.
Individuals are in one frame each, or in very unequal numbers of frames, and are found in all of
them or in none, or in some. "Before" is the mean
and Student's half width of the jackknife's error; "in use" what pages show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray
from scipy import stats

from tracking.findings.best_placement import best_placement
from tracking.findings.summary import seed_means
from tracking.statistics.all_pairs import AllPairs
from tracking.statistics.jackknife import sample_error
from tracking.statistics.reliability import Noise
from training.leave_out import Units, means_without_each, units_of
from training.matches import Matches

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
FRAMES = 200  # of a route
MEAN_FRAMES = 20.3  # of an individual
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
class Traffic:
    """What is met on a route of `FRAMES` frames."""

    individuals: float = 8.5  # on a route
    alarms: float = 0.4  # false alarms in a frame
    score: float = -0.7  # of a false alarm, mean of the logit
    lasting: bool = False  # false alarms stay as long as individuals


@dataclass(frozen=True)
class TestSet:
    """Scores of one test set. Hits and detections are by placement and seed.

    Attributes:
        truths, routes: as of `training.leave_out.units_of`.
        matches: what was found, by placement, seed.
        frame, nearest: of each detection, its frame and the ground truth that it overlaps.
    """

    truths: pd.DataFrame
    routes: pd.DataFrame
    matches: list[list[Matches]]
    frame: list[list[Numbers]]
    nearest: list[list[Numbers]]

    def units(self, placement: int, seed: int) -> list[Units]:
        """Routes, individuals and nothing."""
        at = self.frame[placement][seed], self.nearest[placement][seed]
        return units_of(self.truths, *at, self.routes)[:3]


def draw(
    routes: int, effect: float, luck: Array, rng: np.random.Generator, traffic: Traffic = Traffic()
) -> TestSet:
    """A test set; `luck` of each training, shape (placements, seeds)."""
    seeds = luck.shape[1]
    met = np.maximum(
        rng.poisson(traffic.individuals * np.exp(2 * effect * rng.standard_normal(routes) * 0.4)), 1
    )
    route_of = np.repeat(np.arange(routes), met)
    n = len(route_of)
    individual, frame = _presence(route_of, rng)
    route, size = route_of[individual], len(individual)
    seen = (
        0.8
        + QUALITY[:, None]
        + rng.standard_normal(n)[individual]
        + OWN[:, None] * rng.standard_normal((PLACEMENTS, n))[:, individual]
        + effect * rng.standard_normal(routes)[route]
        + OWN[:, None] * effect * rng.standard_normal((PLACEMENTS, routes))[:, route]
        + 0.8 * rng.standard_normal(size)
    )
    rate = traffic.alarms * FRAMES * np.exp(effect * rng.standard_normal(routes))
    rate /= MEAN_FRAMES if traffic.lasting else 1
    matches, frames, nearest = [], [], []
    for p in range(PLACEMENTS):
        rows: tuple[list[Matches], list[Numbers], list[Numbers]] = ([], [], [])
        for s in range(seeds):
            value = seen[p] + luck[p, s] + 0.3 * rng.standard_normal(n)[individual]
            value += 0.5 * rng.standard_normal(size)
            score = _sigmoid(value + 0.5 * rng.standard_normal(size))
            hit = np.where(value > 0, score, np.nan)
            boxed = (value > 0) | (rng.random(size) < 0.5)  # half of the missed have a bad box
            where = np.repeat(np.arange(routes), rng.poisson(rate))
            alarm, when = _presence(where, rng, traffic.lasting)
            false = traffic.score + 0.3 * QUALITY[p] + rng.standard_normal(len(where))[alarm]
            rows[0].append(Matches(hit, hit, np.concatenate([score[boxed], _sigmoid(false)])))
            rows[1].append(np.concatenate([frame[boxed], when]))
            rows[2].append(np.concatenate([np.flatnonzero(boxed), np.full(len(when), -1)]))
        for table, row in zip((matches, frames, nearest), rows, strict=True):
            table.append(row)
    truths = pd.DataFrame({"scene": "", "object_id": individual, "frame": frame})
    every = np.arange(routes * FRAMES)
    of_frames = pd.DataFrame({"scene": "", "frame": every, "route": every // FRAMES})
    return TestSet(truths, of_frames, matches, frames, nearest)


def _presence(
    route: Numbers, rng: np.random.Generator, lasting: bool = True
) -> tuple[Numbers, Numbers]:
    """Number and frame of every box of what is on these routes, each in consecutive frames."""
    n = len(route)
    length = np.exp(2.2 + 1.3 * rng.standard_normal(n)) if lasting else np.ones(n)
    frames = np.clip(np.ceil(length), 1, FRAMES).astype(np.int64)
    first = route * FRAMES + rng.integers(FRAMES - frames + 1)
    number = np.repeat(np.arange(n), frames)
    return number, np.arange(len(number)) + (first - np.cumsum(frames) + frames)[number]


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
    results, left_out = [], []
    of = ("Car", "AP_R40_3D", 0.7)
    for p, row in enumerate(test.matches):
        for s, matches in enumerate(row):
            results.append((p, s, whole_ap(matches)))
            for units in test.units(p, s):
                of_each = (units.truth, units.detection, len(units.names))
                table = units.table(*of, matches.area_without_each(*of_each))
                left_out.append(table.assign(placement=p, seed=s, detector="d"))
    table = pd.DataFrame(results, columns=["placement", "seed", "value"])
    table = table.assign(**dict(zip(("class", "metric", "iou"), of, strict=True)), detector="d")
    table = table.assign(difficulty="all", ground_truths=len(test.truths))
    return table, pd.concat(left_out, ignore_index=True)


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
        individuals.append(test.truths["object_id"].nunique())
        found.append([judge(results, table, truth) for table in (None, left_out)])
        before.append(pooled(results, left_out, truth))
    old, new = (pd.DataFrame(rows).mean() for rows in zip(*found, strict=True))
    cells = [f"{np.mean(individuals):.0f}"]
    for name in ("mean", "difference"):
        cells += [f"{100 * side[name]:.0f} (± {side[f'{name} half']:.1f})" for side in (old, new)]
    cells += [f"{100 * value:.0f}" for value in (old["pairs"], np.mean(before), new["pairs"])]
    cells += [f"{100 * side['said']:.0f}" for side in (old, new)]
    return (*cells, f"{100 * new['right']:.0f}")


def recalls(
    individuals: int, truth: float, lasting: bool, boxes: float, rng: np.random.Generator
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Results and left-out values of a recall; `boxes` of an individual scatter so much."""
    number, frame = _presence(np.arange(individuals) // 10, rng, lasting)
    routes = pd.DataFrame({"scene": "", "frame": np.arange(individuals // 10 * FRAMES)})
    routes["route"] = routes["frame"] // FRAMES
    truths = pd.DataFrame({"scene": "", "object_id": number, "frame": frame})
    units = units_of(truths, *[np.zeros(0, np.int64)] * 2, routes)[:3]
    reached = stats.norm.ppf(truth) * np.sqrt(1.09 + boxes**2)
    seen = reached + rng.standard_normal(individuals)[number]
    results, left_out = [], []
    for p, s in product(range(2), range(SEEDS)):
        found = seen + 0.3 * rng.standard_normal(individuals)[number]
        found = (found + boxes * rng.standard_normal(len(frame)) > 0).astype(np.float64)
        results.append({"placement": p, "seed": s, "value": 100 * found.mean()})
        tables = means_without_each("all", [("recall", 0.5, found)], units)
        left_out += [table.assign(placement=p, seed=s, detector="d") for table in tables]
    fixed = {"class": "all", "metric": "recall", "iou": 0.5, "detector": "d", "difficulty": "all"}
    table = pd.DataFrame(results).assign(ground_truths=len(frame), **fixed)
    return table, pd.concat(left_out, ignore_index=True)


def cover_recalls(times: int) -> None:
    head = ["individuals", "true recall"]
    for kind in ("one frame", "all frames or none", "some frames"):
        head += [f"{kind}, before", "in use"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for individuals, truth in product((30, 100, 300), (0.5, 0.9, 0.97, 0.99)):
        cells = [str(individuals), f"{100 * truth:g}"]
        for kind in ((False, 0.0), (True, 0.0), (True, 0.8)):
            rng, rows = np.random.default_rng(individuals), []
            for _ in range(times):
                results, left_out = recalls(individuals, truth, *kind, rng)
                # Infinitely many members of every unit: nothing is added at the bounds.
                for table in (left_out.assign(members=np.inf), left_out):
                    means = seed_means(results, left_out=table)
                    held = means["low"].le(100 * truth + 1e-9) & means["high"].ge(100 * truth)
                    rows.append((held.mean(), (means["high"] - means["low"]).mean() / 2))
            both = 100 * np.array(rows).reshape(times, 2, 2).mean(axis=0)
            cells += [f"{held:.0f} (± {half / 100:.1f})" for held, half in both]
        print("| " + " | ".join(cells) + " |", flush=True)


def main(
    times: Annotated[int, typer.Option(min=2, help="studies of a case")] = 200,
    recall: Annotated[bool, typer.Option("--recall", help="of recall, not of AP")] = False,
) -> None:
    error = 100 * np.sqrt(0.05 * 0.95 / times)
    print(f"{times} studies of a case: the standard error of 95 % is at most {error:.1f} points")
    if recall:
        cover_recalls(times)
        return
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
