"""Additions of docs/extending.md work: each of the seven kinds, installed and not."""

import json
import re

import pandas as pd
import pytest

from lidarplace.logs.box_log import read_box_log
from tests.extending import install, python, write_package
from tests.forked import run_forked
from tests.mlflow_database import write_database
from tests.sweeps.search_files import write_search
from tests.sweeps.small_log import write_sweep
from tests.tracking.made_up_run import NAMES, write_run

PROGRAM = "from sweeps.main import main; main()"


def lidarplace(folder, *words, site=None, code=0):
    """Run a command there; what it prints."""
    result = run_forked(list(words), folder, folder, site=site)
    assert result.returncode == code, result.stdout + result.stderr
    return result.stdout + result.stderr


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    return write_package(tmp_path_factory.mktemp("package"))


@pytest.fixture(scope="module")
def installed(package, tmp_path_factory):
    return install(package, tmp_path_factory.mktemp("site"))


SMALLER = {"detector": None, "lidar": {"beams": 4, "azimuth_steps": 90}}


@pytest.mark.parametrize("name", ["crossed_voxels", "mypkg.crossed_voxels:CROSSED_VOXELS"])
def test_a_surrogate(package, installed, tmp_path, name):
    write_database(tmp_path / "runs/mlflow.db")
    if ":" in name:  # beside the configuration
        (tmp_path / "mypkg").symlink_to(package / "mypkg")
    surrogate = {"resolution": 0.8, "names": ["s_mig", name]}
    keys = {"surrogate": surrogate, "promote": [{"by": name, "keep": 2}]}
    keys["grid"] = {"placement": ["line", "center", "pyramid"]}
    write_sweep(tmp_path, "new.yaml", **SMALLER, **keys)
    lidarplace(tmp_path, "run", "new.yaml", site=None if ":" in name else installed)
    run = tmp_path / "runs/new"
    values = pd.read_parquet(run / "surrogates.parquet").pivot(
        index="placement", columns="surrogate", values="value"
    )
    assert (values[name] > 0).all()
    promoted = pd.read_parquet(run / "promotions.parquet").set_index("placement")
    assert promoted["value"].to_dict() == values[name].to_dict()
    assert promoted["kept"].sum() == 2
    for table in ("accuracy", "sampling_error", "pog_resamples"):
        assert name in set(pd.read_parquet(run / f"{table}.parquet")["surrogate"])
    report = (run / "report.html").read_text(encoding="utf-8")
    assert "crossed voxels (voxels)" in report


def test_a_search_by_a_surrogate(installed, tmp_path):
    write_database(tmp_path / "runs/mlflow.db")
    write_search(tmp_path, search={"objective": "crossed_voxels", "trials": 4}, robustness=None)
    lidarplace(tmp_path, "search", "small.yaml", site=installed)
    trials = pd.read_parquet(tmp_path / "runs/small/trials.parquet")
    best = trials[trials["feasible"]]["value.crossed_voxels"].max()
    search = json.loads((tmp_path / "runs/small/search.json").read_text())
    assert best == search["rigs"]["found_1"]["values"]["crossed_voxels"] > 0


FAILS = """
import math, sys
from itertools import count
from lidarplace.pog.surrogates.table import Surrogate

calls = count()
def value(seen):
    return (lambda: math.inf, lambda: sys.exit(0), lambda: 3.0)[next(calls)]()

FAILS = Surrogate(label="l", unit="u", meaning="m", of_seen=value, sense=1)
"""


def test_a_surrogate_that_fails_for_two_rigs_of_three(tmp_path):
    """Two trials fail with its name and the rig; the third one has its results and its page."""
    (tmp_path / "plug_fails.py").write_text(FAILS)
    write_database(tmp_path / "runs/mlflow.db")
    keys = {"surrogate": {"resolution": 0.8, "names": ["s_mig", "plug_fails:FAILS"]}}
    keys["surrogate"] |= {"accuracy": False, "sampling_error": False}
    keys |= {"grid": {"placement": ["line", "center", "pyramid"]}}
    write_sweep(tmp_path, "new.yaml", **SMALLER, **keys)
    output = lidarplace(tmp_path, "run", "new.yaml", code=1)
    fault = "wrong value; expected one finite real number, found inf"
    assert f"failed: line: plug_fails:FAILS: placement line: {fault}\n" in output
    assert re.search(r"failed: center: plug_fails:FAILS: .*plug_fails.py:8: calls sys.exit", output)
    table = pd.read_parquet(tmp_path / "runs/new/surrogates.parquet")
    assert set(table["placement"]) == {"pyramid"}
    assert (tmp_path / "runs/new/report.html").exists()


USE = """
import json
from pathlib import Path

import pandas as pd
import torch

from lidarplace import Lidar, Mount, OccupancyGrid, Placement, Roi, evaluate
from lidarplace.logs.boxes import GEOMETRY
from sweeps.configuration.search import SearchFile
from sweeps.configuration.point import Point
from sweeps.configuration.sweep import SweepFile
from lidarplace.base.code_version import code_version
from training import build_detector, code_of_network
from training.kitti_ap import evaluation

places = [(10.0 * k, 0.0, 0.8, 4.0, 2.0, 1.5, 0.0) for k in range(80)]
boxes = pd.DataFrame(places, columns=list(GEOMETRY)).assign(frame=0, **{"class": "Car"})
grid = OccupancyGrid.from_boxes(boxes, Roi((0, 20), (-4, 4), (0, 4), 0.5), "Car", frames=1)
rig = Placement("rig", [Mount(z=2.0)], Lidar((-0.2, -0.1), azimuth_steps=90))
print(evaluate(grid, rig, surrogates=["crossed_voxels"])["crossed_voxels"] > 0)

# Three of four objects are found, below as many false alarms: every other detection is one.
good = boxes.iloc[:60].assign(score=0.5)
bad = boxes.iloc[:60].assign(y=15.0, score=0.9)
name = "precision_at_half"
values = evaluation(boxes, pd.concat([good, bad]), [0], ["Car"], metrics=[name]).metrics
print(values[values["metric"] == name]["value"].tolist())
Point.model_validate({"placement": "line", "metrics": [name], "detector": "second_wide_tiny"})

torch.manual_seed(0)
wide, narrow = (build_detector(name, ["Car"]) for name in ("second_wide_tiny", "second_tiny"))
print(sum(p.numel() for p in wide.parameters()) > sum(p.numel() for p in narrow.parameters()))
points = torch.rand(2000, 4) * torch.tensor([10.0, 4.0, 2.0, 1.0])
box = torch.tensor([[5.0, 2.0, 0.8, 4.0, 2.0, 1.6, 0.0]])
wide.loss([points], [box], [torch.tensor([1])])["loss"].backward()
print(all(p.grad is not None and p.grad.isfinite().all() for p in wide.parameters()))
schema = json.dumps(SweepFile.model_json_schema())
print(all(f'"{name}"' in schema for name in (name, "second_wide_tiny", "crossed_voxels", "gap_m")))
"""


def test_metric_detector_schema_and_python(installed, tmp_path):
    output = lidarplace(tmp_path, "-c", USE, site=installed)
    assert output.split("\n") == ["True", "[50.0, 50.0]", "True", "True", "True", ""]


def test_a_reader(installed, tmp_path):
    car = {"class": "Car", "object_id": "7", "x": 9.0, "y": 0.0, "z": 0.8}
    car |= {"length": 4.0, "width": 2.0, "height": 1.6, "yaw": 0.0}
    frames = [[car, car | {"class": "Tram"}], *([[]] * 9)]
    text = "\n".join(json.dumps(frame) for frame in frames)
    (tmp_path / "boxes.json").write_text(text, encoding="utf-8")
    convert = ("convert", "json-lines", "boxes.json", "log")
    assert "json-lines" in lidarplace(tmp_path, "convert", "--help", site=installed)
    output = lidarplace(tmp_path, *convert, site=installed)
    assert "Tram" in output
    log = read_box_log(tmp_path / "log")
    assert log.frames["split"].tolist() == ["train"] * 9 + ["test"]
    assert log.boxes[["frame", "class", "x"]].to_numpy().tolist() == [[0, "Car", 9.0]]

    (tmp_path / "boxes.json").write_text("[", encoding="utf-8")
    assert len(lidarplace(tmp_path, *convert, site=installed, code=2).splitlines()) == 1


def test_a_live_scene(installed, tmp_path):
    keys = {"scene": {"source": "platoon", "frames": 20}}
    keys["grid"] = {"placement": ["line"], "scene.gap_m": [8.0, 12.0]}
    write_sweep(tmp_path, "new.yaml", **SMALLER, **keys)
    lidarplace(tmp_path, "record", "new.yaml", "logs", site=installed)
    log = read_box_log(tmp_path / "logs/scene.gap_m=8.0")
    assert log.frames["split"].value_counts().to_dict() == {"train": 18, "test": 2}
    assert set(log.boxes["x"]) == {8.0, 16.0, 24.0}

    run = ("run", "new.yaml", "--dry-run", "--set")
    output = lidarplace(tmp_path, *run, "scene.frames=9", site=installed, code=2)
    assert "no frame is in the test split; frames is 9, allowed is at least 10" in output
    output = lidarplace(tmp_path, *run, "scene.gap=9", site=installed, code=2)
    assert "scene.gap: unknown key (did you mean gap_m?)" in output
    output = lidarplace(tmp_path, *run, "scene.source=platon", site=installed, code=2)
    assert "(did you mean platoon?)" in output


def test_a_section(installed, tmp_path):
    run = write_run(tmp_path / "made_up", seeds=(1, 2, 3), points=10)
    lidarplace(tmp_path, "report", "made_up", site=installed)
    page = (run / "report.html").read_text(encoding="utf-8")
    assert 'href="#trainings"' in page
    assert "## Trainings" in (run / "report.md").read_text(encoding="utf-8")
    rows = (run / "tables/trainings.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "placement,trainings"
    assert [row.rpartition(",")[2] for row in rows[1:]] == ["3"] * len(NAMES)


def test_a_command(installed, tmp_path):
    listed = lidarplace(tmp_path, "--help", site=installed)
    assert "\n  beams          Print the elevations of a LiDAR model.\n" in listed
    assert len(lidarplace(tmp_path, "beams", "vlp16", site=installed).split()) == 16
    output = lidarplace(tmp_path, "beams", "vlp17", site=installed, code=2)
    assert output.count("\n") == 1
    assert "vlp16" in output


def test_a_broken_command_leaves_others_alone(tmp_path):
    info = tmp_path / "bad-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bad\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[lidarplace.commands]\nbad = bad_commands:app\nrun = bad_commands:app\n"
        "none = nowhere:app\n"
    )
    (tmp_path / "bad_commands.py").write_text('"""Do it."""\n1 / 0\n')
    listed = python(tmp_path, "-c", PROGRAM, "--help", path=tmp_path)
    assert "\n  run            Run a sweep. [sweeps]\n" in listed
    assert "\n  bad            Do it.\n" in listed
    assert "\n  none           broken: ModuleNotFoundError: no module nowhere\n" in listed
    output = python(tmp_path, "-c", PROGRAM, "bad", path=tmp_path, code=2)
    assert output == (
        "bad (bad_commands): cannot be imported: ZeroDivisionError: division by zero; "
        "repair or uninstall it\n"
    )
