"""How numbers that need no training predict detectors of the shuttle's random rigs.

Run as `python studies/proof/shuttle_table.py [RUN]`. The run folder of `shuttle.yaml` replaces
`shuttle.parquet`; without it this is read. Prints Spearman's rho with 95 % over rigs; with one
seed, the seeds' noise is in it.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from scipy import stats

from tracking.findings.paired import with_sums
from tracking.statistics.confidence_interval import intervals

TABLE = Path(__file__).parent / "shuttle.parquet"
TARGETS = {
    "Pedestrian recall": ("Pedestrian", "class_recall_3D", 0.5),
    "Cyclist recall": ("Cyclist", "class_recall_3D", 0.5),
    "recall of all": ("all", "recall", 0.5),
    "Car AP over IoU": ("Car", "AP_R40_3D_mean", 0.0),
}
"""Class, metric, IoU; 0: over all of them."""
PREDICTORS = {
    "pretrained": "the package's generalist",
    "expected_recall": "expected recall",
    "covered_entropy": "covered entropy",
    "expected_ig": "expected IG",
    "lidars": "number of LiDARs",
}


def main() -> None:
    """Print a row for each of PREDICTORS, a column for each of TARGETS."""
    if len(sys.argv) > 1:
        distilled(Path(sys.argv[1])).to_parquet(TABLE, index=False)
    print(shuttle_table())


def distilled(run: Path) -> pd.DataFrame:
    """Return what is predicted and what detectors reach: placement, target, name, value.

    Means over the tests. `name` is one of PREDICTORS, or "specialist"."""
    results = pd.read_parquet(run / "results.parquet")
    surrogates = with_sums(pd.read_parquet(run / "surrogates.parquet"))
    rows = []
    for target, (object_class, metric, iou) in TARGETS.items():
        same = (results["class"] == object_class) & (results["metric"] == metric)
        reached = results[same & np.isclose(results["iou"], iou)]
        reached = reached.rename(columns={"evaluator": "name"})
        scored = surrogates[surrogates["class"] == object_class]
        scored = scored.rename(columns={"surrogate": "name"})
        rows += [table.assign(target=target) for table in (reached, scored)]
    keys = ["placement", "target", "name"]
    every = pd.concat(rows, ignore_index=True).groupby(keys, as_index=False)["value"].mean()
    return every[every["name"].isin([*PREDICTORS, "specialist"])]


def shuttle_table() -> str:
    """Make the table of rho as Markdown."""
    lines = [f"| ρ (95 % over rigs) | {' | '.join(TARGETS)} |", "|---" * (1 + len(TARGETS)) + "|"]
    for name, words in PREDICTORS.items():
        lines.append(f"| {words} | {' | '.join(interval(name, target) for target in TARGETS)} |")
    return "\n".join(lines)


def interval(name: str, target: str) -> str:
    """Return Spearman's rho of a predictor with detectors, and its interval."""
    x, y = _both(name, target)
    low, high = intervals(x.to_numpy(np.float64), y.to_numpy(np.float64)[:, None], "spearman")
    return f"{rho(name, target)} ({low:.2f} to {high:.2f})"


def rho(name: str, target: str) -> str:
    """Return Spearman's rho of a predictor with detectors."""
    return f"{stats.spearmanr(*_both(name, target)).statistic:.2f}"


def spread(target: str) -> str:
    """Return what detectors of the worst and the best rig reach, percent."""
    reached = _both("specialist", target)[1]
    return f"{reached.min():.0f} to {reached.max():.0f} %"


def _both(name: str, target: str) -> tuple[pd.Series, pd.Series]:
    rows = pd.read_parquet(TABLE).query("target == @target")
    values = rows.pivot(index="placement", columns="name", values="value")
    rigs = yaml.safe_load((TABLE.parent / "shuttle.yaml").read_text(encoding="utf-8"))["placements"]
    lidars = pd.Series({rig: len(content["mounts"]) for rig, content in rigs.items()})
    values["lidars"] = lidars.reindex(values.index)
    return values[name], values["specialist"]


if __name__ == "__main__":
    main()
