"""Roll, pitch, density, sensitivity and the paper's tables."""

import json
from dataclasses import astuple

import numpy as np
import pandas as pd
import pytest

from lidarplace import PAPER_PLACEMENTS
from lidarplace.rigs.placement import Mount
from tests.tracking.made_up_run import report_of, write_run
from tests.tracking.result_tables import tables
from tests.tracking.test_report import Page
from tracking.findings.summary import seed_means
from tracking.findings.surrogate_accuracy import rank_agreement, relative_errors, summarise
from tracking.published import TABLES, published_detection, published_surrogates
from tracking.report.sections.ablations import TiltPair, tilt_pairs
from tracking.report.sections.published import paper_names
from tracking.report.sections.sampling_error import paired_differences, separation_sentences
from tracking.report.sections.sensitivity import sensitivity

SHOWN = ("line", "line_roll", "center", "trapezoid", "pyramid", "pyramid_pitch")
PAPER = {name: tuple(placement.mounts) for name, placement in PAPER_PLACEMENTS.items()}


def test_pairs_differ_in_one_angle_alone():
    wanted = [TiltPair("roll", name, f"{name}_roll") for name in ("line", "pyramid")]
    assert tilt_pairs(PAPER) == [*wanted, TiltPair("pitch", "pyramid", "pyramid_pitch")]


def test_the_order_of_the_lidars_does_not_matter_and_equal_tilts_are_no_pair():
    left = (Mount(y=0.5, roll=0.2), Mount(y=-0.5))
    right = (Mount(y=-0.5, roll=0.2), Mount(y=0.5))
    level = (Mount(y=-0.5), Mount(y=0.5))
    pairs = tilt_pairs({"left": left, "right": right, "level": level})
    assert pairs == [TiltPair("roll", "level", "left"), TiltPair("roll", "level", "right")]


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Page:
    path, densities = tmp_path_factory.mktemp("paper") / "paper", (40, 120)
    folder = write_run(path, SHOWN, densities=densities, detectors=("second_tiny",))
    sweep = json.loads((folder / "sweep.json").read_text())
    for name in SHOWN:
        sweep["placements"][name] = [list(astuple(mount)) for mount in PAPER[name]]
    (folder / "sweep.json").write_text(json.dumps(sweep))
    built = report_of(folder, "published", "sensitivity", "tilts", "density")
    page = Page(built.read_text(encoding="utf-8"))
    page.folder = folder
    return page


def test_the_ablations_have_their_sections(page):
    ablations = ("Does the placement matter?", "Ablation: roll and pitch", "Ablation: density")
    for words in ("The paper's published results", *ablations, "density 40", "density 120"):
        assert words in page.words


def test_a_difference_is_that_of_the_means_and_its_interval_covers_it(page):
    table = pd.read_csv(page.folder / "tables" / "roll-and-pitch.csv")
    results = pd.read_parquet(page.folder / "results.parquet")
    rows = results.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")
    means = rows[rows["scene.density"] == 40].groupby("placement")["value"].mean()
    wanted = table["detector"].str.contains("40") & (table["pair"] == "line → line_roll")
    same = (table["class"] == "Car") & (table["metric"] == "AP_R40_3D")
    row = table[wanted & same].iloc[0]
    assert row["difference (points)"] == pytest.approx(means["line_roll"] - means["line"])
    assert row["low (points)"] < row["difference (points)"] < row["high (points)"]


def test_published_tables_are_whole():
    detection, surrogates = published_detection(), published_surrogates()
    assert set(detection["table"]) == set(TABLES)
    assert set(detection["placement"]) <= set(PAPER)
    assert detection["value"].between(0, 100).all()
    row = detection.query("detector == 'pv_rcnn' and placement == 'pyramid' and metric == 'recall'")
    assert 62.60 in row["value"].tolist()
    # IG is H_POG + S-MIG, as in the paper, to its rounding.
    density = surrogates[surrogates["table"] == "density"]
    wide = density.pivot(index="density", columns="surrogate", values="value")
    assert np.allclose(wide["ig"], wide["h_pog"] + wide["s_mig"], atol=1000)


def test_a_placement_stands_for_the_papers_by_its_mounts():
    mounts = {"found": PAPER["center"], "line": PAPER["square"], "square": PAPER["square"]}
    assert paper_names(mounts) == {"center": "found", "square": "square"}


def test_published_and_own_stand_side_by_side_for_the_same_network(page):
    table = pd.read_csv(page.folder / "tables" / "published-and-own.csv")
    assert set(table["detector"]) == {"second"}
    assert set(table["placement"]) == {"center", "line", "pyramid", "trapezoid"}


def test_spread_by_chance_is_exceeded_by_one_sweep_in_twenty():
    y = 60 + np.random.default_rng(0).normal(size=(300, 5, 3))
    each = [tables(range(5), values)[0].assign(detector=f"d{k}") for k, values in enumerate(y)]
    table = sensitivity(seed_means(pd.concat(each)))
    assert 0.02 < (table["spread"] > table["by_chance"]).mean() < 0.09
    assert (table["relative"] - table["spread"] / table["mean"]).abs().max() < 1e-12


def test_one_seed_tells_nothing_about_chance():
    table = sensitivity(seed_means(tables(range(3), [[0.0], [1.0], [2.0]])[0]))
    assert table["spread"].tolist() == [2.0]
    assert table["by_chance"].isna().all()


def test_errors_and_ranks():
    rows = []
    for name, fine in (("a", -1.0), ("b", -2.0), ("c", -4.0)):
        ways = [("cone", 0.1, 0, fine), ("cone", 0.2, 0, 2 * fine)]
        ways += [("dda", 0.2, 90, 1.5 * fine), ("dda", 0.2, 9, 1 / fine - 9)]
        rows += [(name, "Car", "s_mig", *way, 10, value, 0.1, 1.0) for *way, value in ways]
    columns = ["placement", "class", "surrogate", "method", "resolution", "azimuth_steps"]
    table = pd.DataFrame(rows, columns=[*columns, "frames", "comparable", "seconds", "pog_seconds"])
    table["reference"] = table["resolution"] == 0.1
    summary = summarise(relative_errors(table)).set_index(["resolution", "azimuth_steps"])
    assert summary["median_error"].iloc[:3].tolist() == pytest.approx([0, 1, 0.5])
    assert summary["median_method_error"].iloc[:3].tolist() == pytest.approx([0, 0, 0.25])
    assert summary["spearman"].tolist() == pytest.approx([1, 1, 1, -1])
    assert summary["kendall"].tolist() == pytest.approx([1, 1, 1, -1])
    assert summary["reference"].tolist() == [True, False, False, False]


def test_no_rank_of_two_or_of_equal_values():
    assert np.isnan(rank_agreement([1, 2], [1, 2])).all()
    assert np.isnan(rank_agreement([1, 1, 1], [1, 2, 3])).all()


def test_pairs_are_told_apart_though_their_intervals_overlap(run):
    pairs = paired_differences(run.sampling_error, run.pog_resamples)
    assert len(pairs) == 10
    assert ((pairs["low"] > 0) | (pairs["high"] < 0)).all()
    assert "does not blur" in separation_sentences(pairs, "Car")[0]
    assert "S-MIG 0 of 10" in separation_sentences(pairs.assign(low=-1.0, high=1.0), "Car")[0]
