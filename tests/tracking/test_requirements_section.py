"""Requirements on the pages of a run folder, and in MLflow."""

import html
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace import PAPER_PLACEMENTS
from lidarplace.mounting.outline import outline
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Area, Positions
from lidarplace.requirements.check_requirements import CaseResult, RequirementResult
from lidarplace.requirements.requirement import Requirement
from lidarplace.requirements.tables import Ground, case_table, worst_cases
from tests.refused import refused
from tests.tracking.made_up_run import report_of
from tracking.findings.groups import met, worst_requirements
from tracking.mlflow.content import requirement_metrics
from tracking.pages.requirements import requirement_map
from tracking.report.analysis import Analysis
from tracking.run_folders.arrays import Grounds
from tracking.run_folders.sweep import RunFolder

NEAR, FAR = "near / left", "far <3 m>"


def case(placement, requirement, name, value, at_least):
    row = {"requirement": requirement, "measure": "points", "at_least": at_least, "for": 0.9}
    value_row = {"met": value >= at_least, "value": value, "short_by": max(0.0, at_least - value)}
    place = {
        "enough": 0.5,
        "undecided": 0.0,
        "x": 1.0,
        "y": -2.0,
        "heading_deg": 45.0,
        "at_worst": 0.0,
    }
    return {"placement": placement, "case": name, **row, **value_row, **place}


@pytest.fixture(scope="module")
def folder(made_up_run, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("required") / "grid"
    shutil.copytree(made_up_run, folder)
    rows, least = [], {}
    for number, name in enumerate(RunFolder.read(folder).placements):
        rows.append(case(name, NEAR, "as built", 20.0, 10.0))
        rows.append(case(name, NEAR, "without LiDAR 1", 2.0 * number, 10.0))
        rows.append(case(name, FAR, "as built", 7.0, 5.0))
        least |= {f"{i}/{name}": np.full((2, 3), number, np.float32) for i in range(2)}
    pd.DataFrame(rows).to_parquet(folder / "requirements.parquet")
    line = {"0": np.arange(2.0), "1": np.arange(2.0)}
    other = {"0": np.arange(3.0), "1": np.arange(3.0)}
    body = np.array([[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, -1.0], [np.nan, np.nan]])
    Grounds(body, np.array([NEAR, FAR]), line, other, least).write(folder)
    report_of(folder, "requirements", "placements", "failures")
    return folder


def test_the_worst_case_decides(folder):
    run = RunFolder.read(folder)
    worst = worst_requirements(run, {})
    assert len(worst) == 2 * len(run.placements)
    number = {name: i for i, name in enumerate(run.placements)}
    for name, row in worst[worst["requirement"] == NEAR].set_index("placement").iterrows():
        dead = 2.0 * number[name] < 20.0
        assert row["case"] == ("without LiDAR 1" if dead else "as built")
        assert row["met"] == (number[name] >= 5)
        assert met(worst)[name] == ("2 of 2" if number[name] >= 5 else "1 of 2")


def test_grounds_are_read_as_they_were_written(folder):
    grounds = RunFolder.read(folder).grounds
    name = next(iter(RunFolder.read(folder).placements))
    assert grounds.under("nobody", NEAR) is None
    assert grounds.under(name, "nothing") is None
    assert grounds.under(name, FAR).least.tolist() == [[0.0] * 3] * 2


@pytest.mark.parametrize("page", ["report.html", "decision.html"])
def test_the_pages_fold_them_and_draw_what_fails(folder, page):
    text = (folder / page).read_text(encoding="utf-8")
    section = text.split('<h2 id="requirements">Requirements</h2>')[1].split("</section>")[0]
    names = list(RunFolder.read(folder).placements)
    assert '<details class="folded"><summary><h2 id="requirements">' in text
    assert "FAIL" in section
    assert f"{html.escape(FAR)}: FAIL" not in section, "it is met"
    assert "without LiDAR 1" in section
    if page == "report.html":
        assert f"Failed verdicts: {min(5, len(names))} of {2 * len(names)}." in section
        assert "requirements met" in text
        return
    assert 'href="#requirements"' in text
    first = text.split('<h2 id="requirements">')[0]
    assert "requirements: near / left." in first or "meets all 2 requirements" in first


def test_a_wrong_file_is_told_by_name(folder, tmp_path):
    grounds = RunFolder.read(folder).grounds
    Grounds(grounds.body, grounds.names, grounds.x, grounds.x, grounds.least).write(tmp_path)
    with refused(r"requirements\.npz: least/0/.*: expected shape .*, found "):
        Grounds.read(tmp_path)
    Grounds(grounds.body[0], grounds.names, grounds.x, grounds.y, grounds.least).write(tmp_path)
    with refused(("requirements.npz", "body", "(2,)")):
        Grounds.read(tmp_path)


def test_metrics_of_mlflow(folder):
    cases = pd.read_parquet(folder / "requirements.parquet")
    of_first = cases[cases["placement"] == cases["placement"].iloc[0]]
    shares = {"requirement.near _ left": 0.0, "requirement.far _3 m_": 1.4}
    assert requirement_metrics(of_first) == shares | {
        "requirements_failed": 1.0,
        "requirements_open": 0.0,
    }
    undecided = 0.01 * (of_first["requirement"] == NEAR)
    metrics = requirement_metrics(of_first.assign(undecided=undecided))
    assert (metrics["requirements_failed"], metrics["requirements_open"]) == (0, 1)


def test_an_open_verdict_is_neither_failed_nor_met(folder):
    run = RunFolder.read(folder)
    (best, *_) = Analysis(run).recommended
    cases = run.requirements
    rows = (cases["placement"] == best.best.best) & (cases["requirement"] == NEAR)
    opened = cases.assign(undecided=0.01 * rows, met=cases["met"] & ~rows)
    required = replace(best, run=replace(best.run, requirements=opened)).required
    assert required.endswith(f"fails 0 of 2 requirements; 1 open (finer positions decide): {NEAR}.")


def drawn(numbers, held, needed):
    """The heat map of numbers on a grid of a metre."""
    positions = Positions(np.arange(len(held)) * 1.0, np.arange(held.shape[1]) * 1.0, held)
    wanted = Requirement("<who>", Area(), "points", needed)
    worst = CaseResult("as built", 0.0, 0.5, 3.0, 0.0, 0.0, 0.0)
    result = RequirementResult("a<b", wanted, (worst,), positions, numbers[held])
    (row,) = worst_cases(case_table([result]), []).to_dict("records")
    mounts = PAPER_PLACEMENTS["line"].mounts
    plot = requirement_map(row, Ground.of(result), "a<b", mounts, outline(Vehicle.car()))
    assert plot.layout.title.text == "a&lt;b · &lt;who&gt;: FAIL"
    return plot.data[0]


def test_colours_are_in_terms_of_the_need():
    numbers = np.array([[0.0, 5.0], [10.0, 90.0]])
    figure = drawn(numbers, np.array([[True, True], [True, True]]), 10.0)
    assert figure.z.tolist() == [[0.0, 1.0], [0.5, 2.0]], "rows run along y"
    assert np.array_equal(figure.customdata, numbers.T)


def test_of_many_positions_the_worst_is_seen():
    numbers = np.full((500, 3), 20.0)
    numbers[333, 1] = 1.0
    held = np.ones((500, 3), bool)
    held[:, 2] = False
    figure = drawn(numbers, held, 10.0)
    assert figure.z.shape[1] <= 160
    assert np.nanmin(figure.customdata) == 1.0
    assert (figure.customdata[1] == 1.0).sum() == 1
    assert np.isnan(figure.customdata[2]).all()
    assert abs(figure.x[int(figure.customdata[1].argmin())] - 333) < 4
