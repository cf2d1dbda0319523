"""The contrasts of the proof: what one rig gains over another, by network and test set.

Run as `python studies/proof/contrast.py [RUN ...]`. Run folders of `verify.yaml` and `budgets.yaml`
replace the rows of their networks in `contrast.parquet` and `distance.parquet`; without any these
are read.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import pandas as pd
from rich import print as show
from scipy import stats

from lidarplace.command_line.terminal import table
from tracking.statistics.jackknife import sample_error

FOLDER = Path(__file__).parent
PAIRS = (
    ("found", "center"),  # the planned contrast
    ("found", "found_upright"),  # what the rolls are worth
    ("found", "found_lower"),  # what the height is worth
    ("two", "two_stack"),  # planned as well: two LiDARs
    ("bought", "four_stack"),  # planned as well: the price of four vlp16
    ("bought_three", "four_stack"),  # the same price, three LiDARs
    ("bought_cheap", "four_stack"),  # planned as well: a third less
    ("three_hires", "four_stack"),  # what the models of `bought_three` are worth
    ("bought_three", "three_hires"),  # and its poses
)
"""Rigs, and what they are compared with."""
METRICS = {
    "Car AP over IoU": ("Car", "AP_R40_3D_mean", 0.0),
    "Car AP @ 0.7": ("Car", "AP_R40_3D", 0.7),
    "Car AP @ 0.5": ("Car", "AP_R40_3D", 0.5),
    "Car recall": ("Car", "class_recall_3D", 0.5),
    "Pedestrian AP @ 0.5": ("Pedestrian", "AP_R40_3D", 0.5),
    "Cyclist AP @ 0.5": ("Cyclist", "AP_R40_3D", 0.5),
    "Pedestrian recall": ("Pedestrian", "class_recall_3D", 0.5),
    "Cyclist recall": ("Cyclist", "class_recall_3D", 0.5),
    "recall of all": ("all", "recall", 0.5),
}
"""Class, metric, IoU; 0: over all of them. Only `scratch` has AP of pedestrians and cyclists."""
_KEYS = ["network", "test", "placement", "seed", "class", "metric", "iou"]


def main() -> None:
    """Print a table for each of PAIRS."""
    if len(sys.argv) > 1:
        for name, reader in (("contrast.parquet", _read), ("distance.parquet", _by_distance)):
            rows = pd.concat([reader(Path(run)) for run in sys.argv[1:]], ignore_index=True)
            stored = pd.read_parquet(FOLDER / name)
            stored = stored[~stored["network"].isin(rows["network"])]
            pd.concat([stored, rows], ignore_index=True).to_parquet(FOLDER / name, index=False)
        _individuals(Path(sys.argv[1])).to_csv(FOLDER / "individuals.csv", index=False)
    rows = read()
    for pair in PAIRS:
        lines = []
        for network, every in rows.groupby("network"):
            own = every[every["placement"].isin(pair)]
            tests = sorted(set(own["test"]))
            if own["placement"].nunique() < 2:
                continue
            for name, wanted in METRICS.items():
                of_metric = _of(own, wanted)
                if of_metric.empty:
                    continue
                cells = [_cell(of_metric, pair, asked) for asked in (tests, *([t] for t in tests))]
                lines.append((str(network), name, *cells))
        if lines:
            head = ("", "", "mean of the tests", *tests)
            show(table(f"{pair[0]} less {pair[1]}, points, 95 %", head, lines))


def read() -> pd.DataFrame:
    """What was measured: a row a network, test, rig, seed and metric, and without each unit."""
    return pd.read_parquet(FOLDER / "contrast.parquet")


def individuals(object_class: str) -> int:
    """How many road users of a class the tests have."""
    counts = pd.read_csv(FOLDER / "individuals.csv").query("`class` == @object_class")
    return int(counts["individuals"].sum())


def gain(
    network: str, metric: str, test: str | None = None, pair: tuple[str, str] = PAIRS[0]
) -> str:
    """The contrast of a network and metric, mean of the tests or of one, to a tenth of a point."""
    rows = read().query("network == @network")
    tests = sorted(set(rows["test"])) if test is None else [test]
    difference, half, _ = contrast(_of(rows, METRICS[metric]), pair, tests)
    low, high = difference - half, difference + half
    return f"{difference:+.1f} ({low:+.1f} to {high:+.1f})".replace("-", "−")


def has(network: str, rig: str) -> bool:
    """Tell whether detectors of a network were trained for a rig."""
    return rig in set(read().query("network == @network")["placement"])


def seeds(network: str, pair: tuple[str, str] = PAIRS[0]) -> int:
    """How many seeds a contrast has."""
    rows = _of(read().query("network == @network"), METRICS["recall of all"])
    return contrast(rows, pair, sorted(set(rows["test"])))[2]


def independent(metric: str) -> str:
    """Gain and interval over seeds of the independent contrast in a metric of its file."""
    row = pd.read_csv(FOLDER / "independent.csv", index_col="metric").loc[metric]
    return f"{row['gain']:+.1f} ({row['low']:+.1f} to {row['high']:+.1f})"


def gain_at(network: str, metric: str, from_m: float, pair: tuple[str, str] = PAIRS[0]) -> str:
    """What the rig gains in a ring of distances, mean over seeds and tests, points."""
    rows = pd.read_parquet(FOLDER / "distance.parquet").query("network == @network")
    rows = _of(rows[rows["from_m"] == from_m], METRICS[metric])
    means = rows.set_index("placement")["value"]
    return f"{means[pair[0]] - means[pair[1]]:+.1f}".replace("-", "−")


def contrast(
    rows: pd.DataFrame, pair: tuple[str, str], tests: list[str]
) -> tuple[float, float, int]:
    """The mean difference over seeds and tests, the half-width of its 95 % interval, and seeds.

    Seeds are paired. The objects of a test err alike for all seeds: theirs is the paired jackknife
    error of every report. Degrees of freedom are Satterthwaite's.

    Args:
        rows: of one network and metric, as `_read` has them.
    """
    rig, other = pair
    rows = rows[rows["placement"].isin(pair)]
    whole = rows[rows["unit"] == ""]
    values = whole.pivot_table(index="seed", columns=["test", "placement"], values="value")
    gains = pd.DataFrame({test: values[test][rig] - values[test][other] for test in tests})
    by_seed = gains.dropna().mean(axis=1)
    parts = [(by_seed.var(ddof=1) / len(by_seed), len(by_seed) - 1.0)]
    for test in tests:
        error = sample_error(rows[rows["test"] == test], paired=True)
        if error is None:
            raise ValueError(f"{test}: the error of its objects is unknown")
        parts.append((2 * error.variance / len(tests) ** 2, error.degrees))
    variance = sum(own for own, _ in parts)
    degrees = variance**2 / sum(own**2 / freedom for own, freedom in parts)
    half = stats.t.ppf(0.975, degrees) * math.sqrt(variance)
    return float(by_seed.mean()), float(half), len(by_seed)


def _cell(rows: pd.DataFrame, pair: tuple[str, str], tests: list[str]) -> str:
    difference, half, known = contrast(rows, pair, tests)
    low, high = difference - half, difference + half
    return f"{difference:+.2f} ({low:+.2f} to {high:+.2f}), {known} seeds"


def _of(rows: pd.DataFrame, wanted: tuple[str, str, float]) -> pd.DataFrame:
    object_class, metric, iou = wanted
    same = (rows["class"] == object_class) & (rows["metric"] == metric)
    return rows[same & ((rows["iou"] - iou).abs() < 1e-6)]


def _individuals(run: Path) -> pd.DataFrame:
    """Of each test and class."""
    rows = pd.read_parquet(run / "individuals.parquet").query("split == 'test'")
    rows = rows.assign(test=_test_of(rows))[["test", "class", "scene", "object_id"]]
    each = rows.drop_duplicates().groupby(["test", "class"], as_index=False)
    return each.size().rename(columns={"size": "individuals"})


def _test_of(rows: pd.DataFrame) -> pd.Series:
    return rows["scene.test_folder"].map(lambda folder: Path(folder).parent.name)


def _by_distance(run: Path) -> pd.DataFrame:
    """Means over seeds and tests, by distance."""
    rows = pd.read_parquet(run / "distance.parquet")
    rows = pd.concat([_of(rows, wanted) for wanted in METRICS.values()], ignore_index=True)
    keys = ["placement", "class", "metric", "iou", "from_m", "to_m"]
    means = rows.groupby(keys, as_index=False)["value"].mean()
    return means.assign(network=run.name.removeprefix("proof_"))


def _read(run: Path) -> pd.DataFrame:
    """Results, and the same without each unit of the test objects, under short names."""
    results = pd.read_parquet(run / "results.parquet").assign(unit="", left_out="")
    left_out = pd.read_parquet(run / "left_out.parquet")
    left_out = left_out[left_out["unit"] != "half"]
    rows = pd.concat([results, left_out], ignore_index=True)
    rows = pd.concat([_of(rows, wanted) for wanted in METRICS.values()], ignore_index=True)
    rows = rows.assign(test=_test_of(rows), network=run.name.removeprefix("proof_"))
    rows["left_out"] = rows["left_out"].astype(str)
    rows = rows[[*_KEYS, "unit", "left_out", "ground_truths", "value"]]
    of_seeds, of_units = rows[rows["unit"] == ""], rows[rows["unit"] != ""]
    keys = [name for name in of_units if name not in ("seed", "value")]
    of_units = of_units.groupby(keys, as_index=False)["value"].mean().assign(seed=0)
    return pd.concat([of_seeds, of_units], ignore_index=True)


if __name__ == "__main__":
    main()
