"""How noisy differences between placements are: seed by seed, and between independent seeds.

    python -m sweeps.run examples/study.yaml
    python benchmarks/studies/paired_differences.py runs/study

Trainings of one seed see the same frames, moved alike, under every placement. What they have in
common cancels in differences that are taken seed by seed. For each metric:

    paired      standard deviation of a difference of two placements with the same seed: sqrt(2)
                times the residual of placement + seed (a two-way analysis of variance)
    unpaired    of two placements with different seeds: sqrt(2) times the spread over seeds within
                placements
    95 %        interval of the paired one, by the chi-squared distribution
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table
from scipy import stats

from tracking.run_folders.sweep import RunFolder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+", help="folders of sweeps without further axes")
    table = Table("run", "class", "metric", "placements", "seeds", "paired", "95 %", "unpaired")
    for path in parser.parse_args().runs:
        results = RunFolder.read(path).results
        results = results[results["difficulty"].isin(["all", "moderate"])]
        keys = ["class", "metric", "iou", "difficulty"]
        for (name, metric, iou, _), rows in results.groupby(keys, sort=False):
            values = rows.pivot(index="placement", columns="seed", values="value").dropna()
            if min(values.shape) < 2 or values.to_numpy().std() == 0:
                continue
            paired, degrees = _paired(values)
            low, high = (
                paired * math.sqrt(degrees / stats.chi2.ppf(p, degrees)) for p in (0.975, 0.025)
            )
            unpaired = math.sqrt(2 * values.var(axis=1, ddof=1).mean())
            table.add_row(
                str(path),
                str(name),
                f"{metric} @ {iou:g}",
                *(str(n) for n in values.shape),
                f"{paired:.2f}",
                f"{low:.2f} to {high:.2f}",
                f"{unpaired:.2f}",
            )
    Console(width=140).print(table)


def _paired(values: pd.DataFrame) -> tuple[float, int]:
    """Standard deviation of paired differences, and its degrees of freedom."""
    rest = values.sub(values.mean(axis=1), axis=0)
    rest = rest.sub(rest.mean(axis=0), axis=1)
    degrees = (values.shape[0] - 1) * (values.shape[1] - 1)
    return math.sqrt(2 * float((rest**2).to_numpy().sum()) / degrees), degrees


if __name__ == "__main__":
    main()
