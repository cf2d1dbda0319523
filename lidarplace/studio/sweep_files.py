"""Configurations of sweeps over the rigs of a studio, and their results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from lidarplace.base.roi import Roi
from lidarplace.configuration.mounting import REAL_MOUNTS
from lidarplace.configuration.renamed_keys import current_key, with_current_keys
from lidarplace.files.columns import check_columns
from lidarplace.files.tables import read_csv
from lidarplace.studio.rig import Rig
from lidarplace.studio.rigs_file import RigsFile
from lidarplace.studio.violations import check_sweepable

Content = dict[str, Any]
"""Content of a configuration, as plain data."""

RUNS = Path("runs")
"""Folder of run folders, as of any sweep."""
MOST_RAYS = 100_000
"""Rays of a rig in evaluated clouds; the generalist was trained on at most about twice as many."""
EVALUATION: Content = {
    "evaluator": "pretrained",
    "mounting_errors": REAL_MOUNTS.model_dump(exclude_unset=True),
    "surrogate": {"names": ["covered_entropy"], "accuracy": False, "sampling_error": False},
}
"""Settings of an evaluation, where its file does not say otherwise."""
INTERVAL = ("mean", "low", "high")


def sweep_of(
    rigs: Sequence[Rig], file: RigsFile, scene: Mapping[str, Any], roi: Roi, classes: Sequence[str]
) -> Content:
    """Return the configuration of a sweep over the rigs that have LiDARs; `scene` is its traffic.

    Raises ValueError: no rig has a LiDAR, or one is inside of the body or sees nothing of the
    ROI."""
    for rig in rigs:
        check_sweepable(rig, file, roi)
    placements = {rig.name: rig.written for rig in rigs if rig.lidars}
    if not placements:
        raise ValueError("no rig has a LiDAR; a sweep needs one")
    same = ("requirements", "allow_blind_lidars")
    return {
        **_carrier(file),
        **{key: file.content[key] for key in same if key in file.content},
        "scene": dict(scene),
        "roi": {axis: list(getattr(roi, axis)) for axis in "xyz"},
        "classes": list(classes),
        "lidar": file.content.get("lidar", {}),
        "surrogate": {"resolution": roi.resolution},
        "placements": placements,
        "grid": {"placement": list(placements)},
    }


def _carrier(file: RigsFile) -> Content:
    """Return the keys `site` and `vehicle` of a sweep, with the keep-outs; none for a sedan."""
    site = {} if file.site is None else {"site": file.content["site"]}
    vehicle = file.carrier_settings
    dumped = vehicle and vehicle.model_dump(mode="json", exclude_defaults=True)
    return site if dumped is None or (site and not dumped) else site | {"vehicle": dumped}


def evaluation_of(sweep: Content, file: RigsFile, before: Content | None = None) -> Content:
    """Return a sweep of `sweep_of`, evaluated in seconds by the generalist of the package.

    `before` is an earlier evaluation, which is brought up to date: its evaluator stays."""
    content = EVALUATION | with_current_keys(before or {})
    rigs = (Rig.of_written(name, rig) for name, rig in sweep["placements"].items())
    rays = max(sum(lidar.rays for lidar in rig.models(file.lidar)) for rig in rigs)
    share = {"cloud_share": round(MOST_RAYS / rays, 3)} if rays > MOST_RAYS else {}
    return {
        **content,
        **sweep,
        "lidar": share | sweep["lidar"],
        "surrogate": content["surrogate"] | sweep["surrogate"],
        "grid": content.get("grid", {}) | sweep["grid"],
        "output": str(RUNS),
    }


def is_evaluation(content: Any) -> bool:
    """Return whether a file's content can be brought up to date by `evaluation_of`."""
    if not isinstance(content, dict):
        return False
    evaluators = [value for key, value in content.items() if current_key(str(key)) == "evaluator"]
    if evaluators not in (["pretrained"], ["generalist"]):
        return False
    return all(isinstance(content.get(key, {}), dict) for key in ("surrogate", "grid"))


def found_by_sweep(run: Path) -> dict[str, pd.DataFrame]:
    """Return AP and recall by the name of the metric, from the tables of a run folder's report.

    Each is a table with index `placement`, columns `mean`, `low` and `high`, the ends of the 95 %
    interval, in percent; NaN where it is not known. Raises ValueError: a table cannot be read."""
    tables = {}
    for path in sorted((run / "tables").glob("best-*.csv")):
        table = read_csv(path)
        check_columns(list(table.columns), ["placement", *INTERVAL], str(path))
        metric = path.stem.removeprefix("best-").replace("-", " ")
        tables[metric] = table.set_index("placement")[list(INTERVAL)]
    return tables
