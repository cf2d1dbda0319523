"""Does the jackknife know how much AP differs between test sets?

    python benchmarks/studies/ap_jackknife.py               # 150 test sets of a case
    python benchmarks/studies/ap_jackknife.py --times 50

Test sets of `individuals_coverage.py`, of routes that do not differ: their boxes belong to
individuals of very unequal numbers of boxes. False alarms have the scores of hits and are so many a
frame, each for itself or "lasting" as long as individuals. Four detectors judge each test set. The
truth is KITTI's AP_R40 in 300 routes, and intervals lie around AP_R40. Their width is the
jackknife's, from what is left of the area under precision over recall

- "route": without each individual; the false alarms of a route are one unit more, as before;
- "individual": without each individual, and without the false alarms of each stretch of frames;
- "in use": the larger one of that and of what is left without each route;
- "AP_R40": as "individual", of AP_R40 itself.

For AP of one detector, and for the difference of two: the true standard deviation over test sets;
what the jackknife's is of it; percent of the 95 % intervals that hold the truth; half their width
in points, and in brackets what it is of the 1.96 true deviations that would do.
"""

from __future__ import annotations

from itertools import product
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from individuals_coverage import PLACEMENTS, Array, TestSet, Traffic, draw, whole_ap
from scipy import stats

from tracking.statistics.jackknife import SampleError, by_unit, error_of_units, sample_error
from training.leave_out import Units
from training.matches import Matches

ROUTES = (2, 4, 9)
ALARMS = ((0.0, False), (0.5, False), (2.0, False), (2.0, True))
POPULATION = 300
WAYS = ("route", "individual", "in use", "AP_R40")
ONE, OTHER = np.triu_indices(PLACEMENTS, 1)


def detectors(routes: int, alarms: tuple[float, bool], rng: np.random.Generator) -> TestSet:
    """A test set, and what a training of every placement that has no luck finds in it."""
    return draw(routes, 0.0, np.zeros((PLACEMENTS, 1)), rng, Traffic(34, alarms[0], 0.5, alarms[1]))


def aps(test: TestSet) -> Array:
    """AP_R40, shape (placements,)."""
    return np.array([whole_ap(row[0]) for row in test.matches])


def left_out(test: TestSet) -> dict[str, pd.DataFrame]:
    """Rows for `sample_error`, by way."""
    tables: dict[str, list[pd.DataFrame]] = {way: [] for way in WAYS}
    for placement, (row, nearest) in enumerate(zip(test.matches, test.nearest, strict=True)):
        routes, individuals, _ = test.units(placement, 0)
        alone, size = nearest[0] < 0, 1 + individuals.truth.max()
        owner = np.where(alone, size + routes.detection, individuals.detection)
        names = (*individuals.names[:size], *routes.names)
        before = Units("individual", names, individuals.truth, owner)
        for way, units in zip((*WAYS, "in use"), (before, *[individuals] * 3, routes), strict=True):
            without_each = Matches.ap_without_each if way == "AP_R40" else Matches.area_without_each
            values = without_each(row[0], units.truth, units.detection, len(units.names))
            table = units.table("Car", "AP_R40_3D", 0.7, values)
            tables[way].append(table.assign(placement=placement, seed=0))
    return {way: pd.concat(rows) for way, rows in tables.items()}


def error_of(rows: pd.DataFrame, way: str, paired: bool) -> SampleError | None:
    """`sample_error`; "route" has false alarms centred together with individuals."""
    if way != "route":
        return sample_error(rows, paired)
    ((*own, _),) = by_unit(rows)
    return error_of_units(*own, "any", paired)


def _cells(off: Array, errors: pd.DataFrame) -> list[str]:
    """Of one way: errors of what was measured, shape (times, …), and those of the jackknife."""
    sd = np.sqrt(off.var(axis=0, ddof=1).mean())
    half = stats.t.ppf(0.975, errors["degrees"]) * np.sqrt(errors["variance"])
    held = (np.abs(off) <= half.to_numpy()[:, None]).mean()
    return [
        f"{sd:.1f}",
        f"{np.sqrt(errors['variance'].mean()) / sd:.2f}",
        f"{100 * held:.0f}",
        f"{half.mean():.1f} ({half.mean() / (1.96 * sd):.2f})",
    ]


def main(times: Annotated[int, typer.Option(min=2, help="test sets of a case")] = 150) -> None:
    head = ["false alarms", "boxes", "individuals", "way", "true sd", "jackknife", "held", "half"]
    head += ["true sd, difference", "jackknife", "held", "half"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for alarms, routes in product(ALARMS, ROUTES):
        truth = aps(detectors(POPULATION, alarms, np.random.default_rng(1)))
        rng = np.random.default_rng(routes)
        sizes, found, errors = [], [], []
        for _ in range(times):
            test = detectors(routes, alarms, rng)
            sizes.append((len(test.truths), test.truths["object_id"].nunique()))
            found.append(aps(test))
            for (way, rows), paired in product(left_out(test).items(), (False, True)):
                error = error_of(rows, way, paired)
                assert error is not None
                errors.append((way, paired, (1 + paired) * error.variance, error.degrees))
        table = pd.DataFrame(errors, columns=["way", "paired", "variance", "degrees"])
        off = np.array(found) - truth
        size = [f"{number:,.0f}" for number in np.mean(sizes, axis=0)]
        for way in WAYS:
            cells = [f"{alarms[0]:g}{', lasting' * alarms[1]}", *size, way]
            for paired, errors_of in ((False, off), (True, off[:, ONE] - off[:, OTHER])):
                own = table[(table["way"] == way) & (table["paired"] == paired)]
                cells += _cells(errors_of, own)
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    typer.run(main)
