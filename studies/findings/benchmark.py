"""Writes the tables and the configuration of `lidarplace benchmark` from those of this study.

Run as `python studies/findings/benchmark.py`, 5 minutes; before it, where the log is to be made
anew, `lidarplace record studies/findings/findings.yaml LOGS` and a copy of `LOGS/sumo-1` to
`sweeps/benchmark/log`.
"""

from __future__ import annotations

import shutil

import pandas as pd
from candidates import FOLDER
from predicting import GENERALIST, of, own_detectors, read, set_aside

from sweeps.benchmark import rigs
from sweeps.benchmark.predictors import BUILT_IN, predict

PEERS = {
    "perception_entropy": "peers.perception_entropy:perception_entropy",
    "expected_ap": "peers.expected_ap:expected_ap",
    "ground_density": "peers.ground_points:density",
    "ground_uniformity": "peers.ground_points:uniformity",
}
"""Predictors of other groups."""

KEPT = ["placement", "seed", "class", "metric", "iou"]


def main() -> None:
    """Write all files beside the log."""
    shutil.copy(FOLDER / "findings.yaml", rigs.FOLDER / "rigs.yaml")
    for name, table in tables().items():
        write(table, name)
    rigs.read.cache_clear()
    write(
        pd.concat(
            [generalists(), *map(predicted, (*BUILT_IN, *PEERS, "pretrained"))], ignore_index=True
        ),
        "predicted",
    )


def tables() -> dict[str, pd.DataFrame]:
    """What detectors of their own reached, as `sweeps.benchmark.rigs.read` has it."""
    own = own_detectors([*own_detectors()["placement"].unique(), *set_aside()])
    left_out = read("main_left_out").query("evaluator == 'specialist'")
    found = {"reached": own[[*KEPT, "value"]]}
    found["left_out"] = left_out[[*KEPT, "unit", "left_out", "ground_truths", "value"]]
    return {name: table.reset_index(drop=True) for name, table in found.items()}


def generalists() -> pd.DataFrame:
    """The three generalists of the study: the mean of each metric."""
    judged = read("main_results").query("evaluator == 'generalist'")
    means = {
        metric: of(judged, target).groupby("placement", sort=False)["value"].mean()
        for metric, target in rigs.METRICS.items()
    }
    table = pd.DataFrame(means).reset_index()
    return table.assign(predictor=GENERALIST, seconds=float("nan"))


def predicted(name: str) -> pd.DataFrame:
    """What a predictor of the package, or one of `PEERS`, says."""
    values, seconds = predict(PEERS.get(name, name))
    table = values.rename_axis("placement").reset_index()
    return table.assign(predictor=name, seconds=seconds)


def write(table: pd.DataFrame, name: str) -> None:
    """A table of the package."""
    path = rigs.FOLDER / f"{name}.parquet"
    table.to_parquet(path, index=False, compression="zstd", compression_level=19)


if __name__ == "__main__":
    main()
