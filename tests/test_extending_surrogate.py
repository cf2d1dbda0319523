"""A surrogate and a metric are two files each, as docs/extending.md has them."""

import json

import pandas as pd
import yaml

from tests.extending import blocks_of, copy_tree, put, python
from tests.mlflow_database import write_database
from tests.sweeps.small_log import write_small_log


def test_a_surrogate_is_two_files(tmp_path):
    tree = copy_tree(tmp_path)
    formula, row = blocks_of("A surrogate")
    imported, row = row.split("\n\n", 1)
    table = tree / "lidarplace/pog/surrogates/table.py"
    (table.parent / "crossed_voxels.py").write_text(formula, encoding="utf-8")
    put(table, '}\n"""Surrogates by name', row)
    put(table, "from lidarplace.pog.surrogates.seen import", f"{imported}\n")

    write_small_log(tree / "log")
    write_database(tree / "runs/mlflow.db")
    config = {
        "detector": None,
        "classes": ["Car"],
        "scene": {"source": "log", "folder": "log"},
        "lidar": {"beams": 4, "azimuth_steps": 90},
        "surrogate": {"resolution": 0.8},
        "grid": {"placement": ["line", "center", "pyramid"]},
        "promote": [{"by": "crossed_voxels", "keep": 2}],
        "ray": "debug",
    }
    (tree / "new.yaml").write_text(yaml.safe_dump(config))
    python(tree, "-m", "sweeps.run", "new.yaml")
    run = tree / "runs/new"
    found = pd.read_parquet(run / "surrogates.parquet").pivot(
        index="placement", columns="surrogate", values="value"
    )
    assert (found["crossed_voxels"] > 0).all()
    promoted = pd.read_parquet(run / "promotions.parquet").set_index("placement")
    assert promoted["value"].to_dict() == found["crossed_voxels"].to_dict()
    assert promoted["kept"].sum() == 2
    for name in ("accuracy", "sampling_error", "pog_resamples"):
        assert "crossed_voxels" in set(pd.read_parquet(run / f"{name}.parquet")["surrogate"])
    errors = pd.read_parquet(run / "sampling_error.parquet").query("surrogate == 'crossed_voxels'")
    kept = found["crossed_voxels"][promoted["kept"]]
    assert errors.set_index("placement")["value"].to_dict() == kept.to_dict()
    report = (run / "report.html").read_text(encoding="utf-8")
    assert "crossed voxels (voxels)" in report
    assert "crossed voxels: rank " in report, "the headline"

    search = {
        "search": {
            "lidars": 2,
            "zones": {"roof": {"x": 0, "y": [-0.6, 0.6], "z": 2}},
            "objective": "crossed_voxels.Car",
            "trials": 3,
        },
        "robustness": None,
    }
    config = {k: v for k, v in config.items() if k not in ("grid", "promote", "detector")} | search
    (tree / "best.yaml").write_text(yaml.safe_dump(config))
    python(tree, "-m", "sweeps.search", "best.yaml")
    (objective,) = json.loads((tree / "runs/best/search.json").read_text())["objectives"]
    assert (objective["direction"], objective["unit"]) == ("maximize", "voxels")


METRIC = """
import json
from pathlib import Path

import pandas as pd

from lidarplace.logs.boxes import GEOMETRY
from sweeps.configuration.sweep import Rung
from sweeps.configuration.search import ObjectiveSettings
from tests.tracking.made_up_run import write_run
from tracking.report.build import build_report
from tracking.run_folders.sweep import RunFolder
from tracking.findings.summary import summary_table
from training.kitti_ap import evaluate_boxes

NAME = "precision_at_half_3D"
places = [(10.0 * k, 0.0, 0.8, 4.0, 2.0, 1.5, 0.0) for k in range(80)]
boxes = pd.DataFrame(places, columns=list(GEOMETRY)).assign(frame=0, **{"class": "Car"})
# Three of four objects are found, below as many false alarms: every other detection is one.
good = boxes.iloc[:60].assign(score=0.5)
bad = boxes.iloc[:60].assign(y=15.0, score=0.9)
values = evaluate_boxes(boxes, pd.concat([good, bad]), [0], ["Car"])
print(json.dumps(values[values["metric"] == NAME]["value"].tolist()))

Rung.model_validate({"by": NAME, "keep": 1, "set": {"training.epochs": 1}})
assert ObjectiveSettings.model_validate({"by": NAME}).best == "maximize"

folder = write_run(Path("made_up"))
results = pd.read_parquet(folder / "results.parquet")
new = results[results["metric"] == "AP_R40_3D"].assign(metric=NAME)
pd.concat([results, new]).to_parquet(folder / "results.parquet", index=False)
run = RunFolder.read(folder)
print(json.dumps(list(summary_table(run).columns)))
build_report(folder)
"""


def test_a_metric_is_two_files(tmp_path):
    tree = copy_tree(tmp_path)
    line, row = blocks_of("A metric")
    put(tree / "training/kitti_ap.py", "        for iou in RECALL_IOU:\n            add(name", line)
    put(tree / "lidarplace/base/metrics.py", '}\n"""Metrics by name', row)
    values, columns = map(json.loads, python(tree, "-c", METRIC).splitlines())
    assert values == [50.0, 50.0], "both IoUs"
    assert "Car P@half@0.7" in columns
    report = (tree / "made_up/report.html").read_text(encoding="utf-8")
    assert "precision at half @ 0.7" in report
