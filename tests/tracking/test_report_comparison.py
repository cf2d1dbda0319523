"""The page that compares several sweeps."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_run import write_run
from test_report import Page
from typer.testing import CliRunner

from tracking.report.command import app
from tracking.report.comparison.build import build_comparison
from tracking.report.comparison.pooled import pooled_table
from tracking.report.comparison.variants import differing_settings, shared_placements
from tracking.run_folders.sweep import RunFolder

FIRST = ("line", "center", "pyramid", "square")
SECOND = ("center", "pyramid", "square", "trapezoid", "mine")


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("sweeps")
    one = write_run(folder / "one", names=FIRST, seed=1)
    two = write_run(folder / "two", names=SECOND, detectors=("tiny", "second"), seed=2)
    (two / "config.yaml").write_text("scene:\n  density: 120\nname: two\n")
    return [one, two]


@pytest.fixture(scope="module")
def page(runs, tmp_path_factory) -> Page:
    built = build_comparison(runs, tmp_path_factory.mktemp("out") / "both")
    assert built.with_suffix(".md").is_file()
    return Page(built.read_text(encoding="utf-8"))


def test_shared_placements_stand_side_by_side(page):
    assert "3 shared placements (same name and same mounts)." in page.text
    table = page.words[page.words.index("Car · 3D AP @ 0.7 (%)") :]
    cells = [word.strip() for word in table if word.strip()]
    start = cells.index("placement")
    assert cells[start + 1 : start + 4] == [
        *("one · pointpillars_tiny", "two · tiny", "two · second"),
    ]
    assert [cell for cell in cells if cell in {*FIRST, *SECOND}][:3] == list(SECOND[:3])


def test_only_settings_that_differ_are_listed(runs, page):
    read = [RunFolder.read(run) for run in runs]
    assert differing_settings(read) == {"scene.density": ["40", "120"]}
    assert "scene.density" in page.words


def test_an_axis_of_the_grid_is_a_setting(tmp_path):
    runs = [write_run(tmp_path / name, detectors=()) for name in ("a", "b", "c")]
    start = "grid:\n  placement: [line]\n  seed: [1]\n"
    (runs[0] / "config.yaml").write_text(start + "  training.epochs: [2]\n")
    (runs[1] / "config.yaml").write_text(start + "  training.epochs: [40, 80]\n")
    (runs[2] / "config.yaml").write_text("grid: {placement: [center]}\ntraining: {epochs: 2}\n")
    one, two, three = (RunFolder.read(run) for run in runs)
    assert differing_settings([one, two]) == {"training.epochs": ["2", "40, 80"]}
    assert differing_settings([one, three]) == {}


def test_the_cautions_of_every_sweep_are_warnings(page):
    for name in ("one", "two"):
        assert f"{name}: Two seeds: the spread over seeds is itself uncertain." in page.text


def test_a_name_of_other_mounts_is_not_compared(tmp_path):
    runs = [write_run(tmp_path / name, names=FIRST) for name in ("a", "b")]
    sweep = json.loads((runs[1] / "sweep.json").read_text())
    sweep["placements"]["line"][0][1] += 0.1
    (runs[1] / "sweep.json").write_text(json.dumps(sweep))
    same, other = shared_placements([RunFolder.read(run) for run in runs])
    assert (same, other) == (list(FIRST[1:]), ["line"])


def test_nothing_shared_is_one_clear_line(tmp_path):
    runs = [write_run(tmp_path / name, names=[f"{name}1", f"{name}2"]) for name in ("a", "b")]
    built = build_comparison(runs, tmp_path / "both")
    page = Page(built.read_text(encoding="utf-8"))
    assert "These sweeps share no placement" in page.text
    assert "AP and recall of the shared placements" not in page.words


def test_a_sweep_without_detectors_is_compared_by_surrogates(tmp_path):
    runs = [write_run(tmp_path / "a"), write_run(tmp_path / "b", detectors=())]
    page = Page(build_comparison(runs, tmp_path / "both").read_text(encoding="utf-8"))
    assert "Surrogates of the shared placements" in page.words
    assert "AP and recall of the shared placements" not in page.words


def test_the_level_of_a_sweep_does_not_count_in_pooled_coefficients(runs):
    read = [RunFolder.read(run) for run in runs]
    before = pooled_table(read).data
    results = read[1].results
    higher = replace(read[1], results=results.assign(value=results["value"] + 30))
    after = pooled_table([read[0], higher]).data
    pd.testing.assert_frame_equal(before, after)
    assert (before["sweeps"] == 2).all()
    assert np.abs(before["pooled_spearman"]).max() <= 1


@pytest.mark.parametrize("case", ["one", "twice", "into a run"])
def test_what_cannot_be_compared_is_said(runs, tmp_path, case):
    given, target = {
        "one": (runs[:1], tmp_path / "out"),
        "twice": ([runs[0], runs[0]], tmp_path / "out"),
        "into a run": (runs, runs[0]),
    }[case]
    with pytest.raises(ValueError, match=r"two different run folders|folder of its own"):
        build_comparison(given, target)
    assert not (tmp_path / "out").exists()


def test_the_command_makes_it_for_several_runs(runs, tmp_path):
    call = CliRunner().invoke
    one, two = map(str, runs)
    found = call(app, [one, two, "--out", str(tmp_path / "both"), "--json"])
    assert found.exit_code == 0
    assert Path(json.loads(found.stdout)["report"]).is_file()
    for words, said in (([one, two], "--out: name"), ([one, "--out", "x"], "--out: leave it out")):
        refused = call(app, words)
        assert refused.exit_code == 2
        assert refused.stderr.startswith(said)
        assert len(refused.stderr.splitlines()) == 1
