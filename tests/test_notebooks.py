"""Notebooks run from the first cell to the last, and are committed without what they print."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from lidarplace import PAPER_PLACEMENTS, OccupancyGrid, Roi, evaluate
from lidarplace.logs.box_log import read_box_log
from tests.tracking.made_up_run import write_run

FOLDER = Path(__file__).parents[1] / "examples/notebooks"


def cells(name: str) -> list[dict[str, Any]]:
    """The cells of code of a notebook."""
    notebook = json.loads((FOLDER / name).read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def run(name: str) -> dict[str, Any]:
    """Run a notebook in the current folder; returns its variables."""
    variables: dict[str, Any] = {}
    for number, cell in enumerate(cells(name)):
        exec(compile("".join(cell["source"]), f"{name}, cell {number}", "exec"), variables)
    return variables


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.ipynb")))
def test_it_is_committed_without_outputs(name):
    for cell in cells(name):
        assert (cell["outputs"], cell["execution_count"]) == ([], None)


@pytest.mark.long  # traffic, clouds and a sweep of its own process
def test_the_quick_start_is_what_a_sweep_computes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    variables = run("quickstart.ipynb")
    ranking, swept = variables["ranking"], variables["wide"]
    assert set(ranking.index) == {*PAPER_PLACEMENTS, "mine"}
    assert list(swept.index) == ["center", "line", "mine"]
    for name in ("covered_entropy", "expected_recall"):
        assert swept[name].to_dict() == pytest.approx(ranking[name][swept.index].to_dict())
    assert (tmp_path / "runs/first/report.html").exists()


def test_a_box_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ranking = run("box_log.ipynb")["ranking"]
    assert set(ranking.index) == {*PAPER_PLACEMENTS, "mine"}
    log = read_box_log(tmp_path / "logs/street")
    roi = Roi(x=(0, 40), y=(-8, 8), z=(0, 4), resolution=0.2)
    grid = OccupancyGrid.from_boxes(log.boxes, roi, object_class="Car", frames=200)
    assert ranking["S-MIG"]["line"] == evaluate(grid, PAPER_PLACEMENTS["line"]).s_mig
    assert ranking["covered entropy"].is_monotonic_decreasing


def test_a_sweep(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = write_run(tmp_path / "runs/grid")
    variables = run("sweep.ipynb")
    table = pd.read_parquet(folder / "results.parquet")
    rows = table[
        (table["metric"] == "AP_R40_3D") & (table["iou"] == 0.7) & (table["class"] == "Car")
    ]
    for name, values in rows.groupby("placement")["value"]:
        assert variables["by_placement"]["mean"][name] == pytest.approx(values.mean())
    assert {"s_mig", "covered_entropy", "expected_ig"} <= set(variables["rho"].index)
    assert variables["rho"]["s_mig"] == pytest.approx(-variables["rho"]["covered_entropy"])
