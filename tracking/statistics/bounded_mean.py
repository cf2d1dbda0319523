"""Centre and variance for the interval of a mean over individuals whose values are bounded.

A share near 0 or 100 %, or AP there, has no spread to estimate its error from: where all of six
individuals are found the jackknife's variance is 0. One individual at each bound is added, which is
Laplace's rule of succession for a share, and Bonett and Price's interval (2012) for the difference
of two shares of the same individuals. Student's interval around that centre then covers 93 to 100 %
at every share and from 6 individuals on (docs/statistics_coverage.md); Wilson's and Clopper and
Pearson's with the effective number of individuals (Korn and Graubard 1998) are wider, as they need
that number at the bounds, and take it everywhere."""

from typing import TypeVar

import pandas as pd

from tracking.statistics import Values

Numbers = TypeVar("Numbers", float, Values, pd.Series)


def with_one_at_each_bound(
    mean: Numbers, variance: Numbers, individuals: Numbers, low: float, high: float
) -> tuple[Numbers, Numbers]:
    """Compute centre and variance of a mean within bounds, with one more individual at each.

    `variance` is the jackknife's of the mean, and `individuals` the number of individuals of equal
    size that weigh as much as those there are, (Σn)² / Σn² over their boxes n; inf adds none."""
    one = 1 / individuals
    weight = 1 / (1 + 2 * one)
    centre = weight * (mean + one * (low + high))
    added = one**2 * ((high - centre) ** 2 + (centre - low) ** 2)
    return centre, weight**2 * (variance + added)
