"""Print the table of `docs/pretrained.md` that compares candidates for the package's weights.

Run as `python studies/pretrained/compare.py`. `candidates.csv` has what `lidarplace benchmark
FILE` predicts of each rig for the second weights, and for the mean of the first and the second,
weight by weight; those of the first are the package's.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from sweeps.benchmark.rigs import HEADLINES, of, populations, read
from tracking.statistics.confidence_interval import corrected

ORIGINS = {"random": "random 20", "all": "all 41"}


def main() -> None:
    """Print a row a candidate: Spearman's rho, in brackets without the seeds' noise."""
    heads = [f"{metric}, {words}" for metric in HEADLINES for words in ORIGINS.values()]
    print(f"| | {' | '.join(heads)} |\n" + "|---" * (1 + len(heads)) + "|")
    for name, predicted in _candidates().items():
        cells = [_rho(predicted, metric, origin) for metric in HEADLINES for origin in ORIGINS]
        print(f"| {name} | {' | '.join(cells)} |")


def _candidates() -> dict[str, pd.DataFrame]:
    table = read("predicted").query("predictor == 'pretrained'").set_index("placement")
    every = pd.read_csv(Path(__file__).parent / "candidates.csv")
    others = {str(name): rows.set_index("rig") for name, rows in every.groupby("weights")}
    metrics = list(HEADLINES)
    first, second = table[metrics], others["second"][metrics]
    return {
        "first weights": first,
        "second weights": second,
        "mean of both weights": others["mean of both"][metrics],
        "mean of both predictions": (first + second) / 2,
    }


def _rho(predicted: pd.DataFrame, metric: str, origin: str) -> str:
    reached = of(read("reached"), metric)
    reached = reached.pivot_table(index="placement", columns="seed", values="value")
    reached = reached.loc[populations()[origin]]
    x = predicted.loc[reached.index, metric]
    rho = stats.spearmanr(x, reached.mean(axis=1)).statistic
    without = corrected(np.array([rho]), reached.to_numpy(np.float64), "spearman")[0]
    return f"{rho:.2f} ({without:.2f})"


if __name__ == "__main__":
    main()
