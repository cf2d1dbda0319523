"""Writes `findings.yaml`: which rigs are judged and trained, and which of them are set aside.

Run as `python studies/findings/design.py [RUN]`. RUN is the run folder of `candidates.yaml`, whose
surrogates become `candidates.csv`; without it that is read. It prints how alike the properties of
the chosen rigs are.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from candidates import FOLDER, write
from numpy.typing import NDArray
from rich import print as show
from scipy.stats import qmc

from lidarplace import PAPER_PLACEMENTS
from lidarplace.command_line.terminal import table
from tracking.run_folders.sweep import RunFolder

PROPERTIES = ("covered_entropy", "expected_points", "expected_recall", "mean height")
"""Of cars; the height is that of the LiDARs, metres."""
RANDOM = 20
SWAPS = 20_000
SEED = 0


def main() -> None:
    """Choose, print, write."""
    if len(sys.argv) > 1:
        _properties(RunFolder.read(Path(sys.argv[1]))).round(4).to_csv(FOLDER / "candidates.csv")
    properties = pd.read_csv(FOLDER / "candidates.csv", index_col="placement")
    chosen = spread(properties.rank(pct=True).to_numpy() - 0.5 / len(properties), RANDOM)
    kept = properties.iloc[sorted(chosen)]
    correlation = kept.corr("spearman")
    rows = [(name, *(f"{value:.2f}" for value in row)) for name, row in correlation.iterrows()]
    show(table(f"Spearman's rho over {len(kept)} rigs at random", ("", *PROPERTIES), rows))
    extra = yaml.safe_load((FOLDER / "rigs.yaml").read_text(encoding="utf-8"))
    drawn = yaml.safe_load((FOLDER / "candidates.yaml").read_text(encoding="utf-8"))["placements"]
    rigs = {name.replace("rig", "random"): drawn[name] for name in kept.index} | extra
    names = [*PAPER_PLACEMENTS, *rigs]
    random = np.random.default_rng(SEED)
    # Of the eight much is known already.
    aside = sorted(random.choice(list(rigs), len(names) // 4, replace=False).tolist())
    write(_study(names, rigs), FOLDER / "findings.yaml", "python studies/findings/design.py")
    (FOLDER / "set_aside.txt").write_text("\n".join(aside) + "\n", encoding="utf-8")
    show(f"{len(names)} rigs, of which {len(aside)} are set aside: {', '.join(aside)}")


def spread(points: NDArray[np.float64], number: int) -> list[int]:
    """Rows that are even in every column and hardly correlated, by swaps.

    Evenness is the centred L2 discrepancy (Hickernell 1998).
    """
    random = np.random.default_rng(SEED)
    chosen = random.choice(len(points), number, replace=False)
    least = _fault(points[chosen])
    for _ in range(SWAPS):
        place, other = int(random.integers(number)), int(random.integers(len(points)))
        if other in chosen:
            continue
        tried = chosen.copy()
        tried[place] = other
        found = _fault(points[tried])
        if found < least:
            chosen, least = tried, found
    return [int(row) for row in chosen]


def _fault(points: NDArray[np.float64]) -> float:
    """Discrepancy, and the mean squared correlation of two columns."""
    correlation = np.corrcoef(points.T)[np.triu_indices(points.shape[1], 1)]
    return float(qmc.discrepancy(points) + np.square(correlation).mean())


def _properties(run: RunFolder) -> pd.DataFrame:
    of_cars = run.surrogates[run.surrogates["class"] == "Car"]
    found = of_cars.pivot_table(index="placement", columns="surrogate", values="value")
    heights = {name: np.mean([m.z for m in mounts]) for name, mounts in run.placements.items()}
    return found.assign(**{"mean height": pd.Series(heights)})[list(PROPERTIES)]


def _study(names: list[str], rigs: dict[str, Any]) -> dict[str, Any]:
    settings = yaml.safe_load((FOLDER / "base.yaml").read_text(encoding="utf-8"))
    return settings | {
        "mounting_errors": {"offset": 0.01, "angle_deg": 0.5},
        "detector": "pointpillars_tiny",
        "training": {"epochs": 6, "rotation": 0.1},
        "generalist": {"rigs": 32, "rigs_per_frame": 8, "epochs": 4},
        "placements": rigs,
        "grid": {"placement": names, "evaluator": ["generalist", "specialist"], "seed": [1, 2, 3]},
    }


if __name__ == "__main__":
    main()
