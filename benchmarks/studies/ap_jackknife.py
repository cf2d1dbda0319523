"""Does the jackknife know how much AP differs between test sets?

    python benchmarks/studies/ap_jackknife.py               # 400 test sets of a case
    python benchmarks/studies/ap_jackknife.py --times 50

Test sets of `individuals_coverage.py`, of routes that do not differ: their boxes belong to few
individuals of very unequal numbers of boxes. Four detectors judge each of them. The truth is
KITTI's AP_R40 in 2,000 routes, and intervals lie around AP_R40. Their width is the jackknife's over
individuals, from what is left of

- AP_R40 without each of at most 100 groups of individuals,
- AP_R40 without each of at most 20 groups, so that a group moves recall by more than a step,
- the area under precision over recall at every hit, without each of at most 100 groups: in use.

For AP of one detector, and for the difference of two: the true standard deviation over test sets;
what the jackknife's is of it; percent of the 95 % intervals that hold the truth; half their width
in points, and in brackets what it is of the 1.96 true deviations that would do.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pandas as pd
import typer
from individuals_coverage import PLACEMENTS, Array, TestSet, draw, whole_ap
from scipy import stats

from tracking.statistics.jackknife import sample_error
from training.matches import Matches

ROUTES = (2, 4, 9, 30)
POPULATION = 2000
METHODS = {
    "AP_R40, 100 groups": (100, Matches.ap_without_each),
    "AP_R40, 20 groups": (20, Matches.ap_without_each),
    "area, 100 groups": (100, Matches.area_without_each),
}
ONE, OTHER = np.triu_indices(PLACEMENTS, 1)


def detectors(routes: int, rng: np.random.Generator) -> TestSet:
    """A test set, and what a training of every placement that has no luck finds in it."""
    return draw(routes, 0.0, np.zeros((PLACEMENTS, 1)), rng)


def aps(test: TestSet) -> Array:
    """AP_R40, shape (placements,)."""
    return np.array([whole_ap(row[0]) for row in test.matches])


def left_out(test: TestSet, method: str) -> pd.DataFrame:
    """Rows for `sample_error`."""
    most, without_each = METHODS[method]
    units = test.individuals + test.routes
    group = np.random.default_rng(0).permutation(units) % min(units, most)
    truth = group[test.individual]
    counts = np.bincount(truth, minlength=min(units, most))
    tables = []
    for placement, (row, owner) in enumerate(zip(test.matches, test.owner, strict=True)):
        values = without_each(row[0], truth, group[owner[0]], len(counts))
        own = {"left_out": np.arange(len(counts)), "ground_truths": counts, "value": values}
        tables.append(pd.DataFrame(own).assign(placement=placement, seed=0, unit="individual"))
    return pd.concat(tables)


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


def main(times: Annotated[int, typer.Option(min=2, help="test sets of a case")] = 400) -> None:
    truth = aps(detectors(POPULATION, np.random.default_rng(1)))
    head = ["boxes", "individuals", "way", "true sd", "jackknife", "held", "half"]
    head += ["true sd, difference", "jackknife", "held", "half"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for routes in ROUTES:
        rng = np.random.default_rng(routes)
        sizes, found, errors = [], [], []
        for _ in range(times):
            test = detectors(routes, rng)
            sizes.append((len(test.individual), test.individuals))
            found.append(aps(test))
            for method in METHODS:
                rows = left_out(test, method)
                for paired in (False, True):
                    error = sample_error(rows, paired)
                    assert error is not None
                    errors.append((method, paired, (1 + paired) * error.variance, error.degrees))
        table = pd.DataFrame(errors, columns=["method", "paired", "variance", "degrees"])
        off = np.array(found) - truth
        size = [f"{number:,.0f}" for number in np.mean(sizes, axis=0)]
        for method in METHODS:
            cells = [*size, method]
            for paired, errors_of in ((False, off), (True, off[:, ONE] - off[:, OTHER])):
                own = table[(table["method"] == method) & (table["paired"] == paired)]
                cells += _cells(errors_of, own)
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    typer.run(main)
