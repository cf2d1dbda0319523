"""How well a generalist and the surrogates tell the rigs' own detectors: from `results.csv`.

Run as `python studies/generalist/table.py`. The CSV files are those of `study.yaml`; rigs without
detectors of their own are left out.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from rich import print as show
from scipy import stats

from lidarplace.command_line.terminal import table

TARGETS = (
    ("Car", "AP_R40_3D", 0.7),
    ("Car", "AP_R40_3D", 0.5),
    ("all", "recall", 0.5),
    ("Cyclist", "AP_R40_3D", 0.5),
)
DRAWS = 4000
"""Of rigs, for 95 % intervals of rho."""


def main() -> None:
    """Print a table for each of TARGETS."""
    folder = Path(__file__).parent
    results = pd.read_csv(folder / "results.csv")
    surrogates = pd.read_csv(folder / "surrogates.csv")
    said = surrogates.groupby(["surrogate", "placement"])["value"].sum().unstack(0)
    for object_class, metric, iou in TARGETS:
        same = (results["metric"] == metric) & (results["class"] == object_class)
        own = results[same & np.isclose(results["iou"], iou)]
        by_evaluator = own.pivot_table(
            index="placement", columns=["evaluator", "seed"], values="value"
        )
        detectors = by_evaluator["specialist"].dropna()
        judged = by_evaluator["generalist"].loc[detectors.index]
        agreement = stats.spearmanr(detectors).statistic
        candidates = pd.DataFrame(
            {"two generalists": judged.mean(axis=1)}
            | {f"generalist, seed {seed}": judged[seed] for seed in judged}
            | {str(name): said.loc[detectors.index, name] for name in said}
        )
        title = (
            f"{object_class} {metric} @ {iou:g}, {len(detectors)} rigs: two seeds of a rig's own "
            f"detectors agree by {agreement:.2f}"
        )
        rows = [_row(name, candidates[name], detectors.mean(axis=1)) for name in candidates]
        show(table(title, ("predictor", "rho", "95 %", "regret"), rows))
        bias = (judged.mean(axis=1) - detectors.mean(axis=1)).mean()
        best = detectors.mean(axis=1).max() - detectors.mean(axis=1).mean()
        show(f"regret of any rig: {best:.1f}; the generalists' mean is {bias:+.1f} points off")


def _row(name: str, values: pd.Series, own: pd.Series) -> tuple[str, str, str, str]:
    random = np.random.default_rng(0)
    x, y = values.to_numpy(), own.to_numpy()
    drawn = []
    for _ in range(DRAWS):
        rows = random.integers(len(x), size=len(x))
        if len(np.unique(x[rows])) > 1:
            drawn.append(stats.spearmanr(x[rows], y[rows]).statistic)
    low, high = np.percentile(drawn, [2.5, 97.5])
    regret = own.max() - own[values.idxmax()]
    rho = stats.spearmanr(x, y).statistic
    return name, f"{rho:+.2f}", f"{low:+.2f} to {high:+.2f}", f"{regret:.1f}"


if __name__ == "__main__":
    main()
