"""Objects that one rig finds and another one misses: counted by hand, and pictured."""

import json
import shutil
from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from lidarplace.base.sectors import SECTORS
from tests.refused import refused
from tests.tracking.made_up_objects import made_up_frames
from tests.tracking.made_up_run import report_of, write_run
from tests.tracking.test_drawn_vehicle import SURFACE
from tests.tracking.test_report import Page
from tracking.findings.failures import Failures, failures
from tracking.findings.groups import groups
from tracking.report.analysis import Analysis
from tracking.report.failures import FOUND, frame_in_space
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import SweepResult


@pytest.fixture(scope="module")
def compared(run) -> Failures:
    comparison = failures(run, next(groups(run)), ("center", "line"))
    assert comparison is not None
    return comparison


def hits(folder: Path) -> pd.DataFrame:
    """A row an object and seed, whether it was found in the columns center and line."""
    table = pd.read_parquet(folder / "found.parquet").merge(
        pd.read_parquet(folder / "trials.parquet")[["trial", "placement", "seed"]]
    )
    table = table[table["placement"].isin(["center", "line"])]
    wide = table.set_index(["object", "seed", "placement"])["found"].unstack().reset_index()
    return wide.merge(pd.read_parquet(folder / "objects.parquet"), on="object")


def test_every_object_is_found_by_both_one_or_none(compared, made_up_run):
    counts = compared.counts()
    rest = counts[["both", "first", "second", "neither"]].sum(axis=1)
    assert rest.to_numpy() == pytest.approx(counts["objects"].to_numpy())
    table = hits(made_up_run)
    for name, of_class in [("all", table), *table.groupby("class")]:
        (row,) = counts[(counts["class"] == name) & (counts["by"] == "")].to_dict("records")
        alone = of_class["center"] & ~of_class["line"]
        assert row["first"] == pytest.approx(alone.sum() / 2)
        assert row["both"] == pytest.approx((of_class["center"] & of_class["line"]).sum() / 2)
        assert row["individuals"] == of_class["object_id"].nunique()
        recall = 100 * (of_class["center"].mean() - of_class["line"].mean())
        assert row["difference"] == pytest.approx(recall)


def test_bins_are_those_that_the_objects_are_in(compared, made_up_run):
    counts = compared.counts().set_index(["class", "by", "bin"])
    table = hits(made_up_run)
    azimuth = np.degrees(np.arctan2(table["y"], table["x"]))
    far = np.hypot(table["x"], table["y"])
    for (by, name), bin_ in {
        ("direction", "front left"): (azimuth >= 22.5) & (azimuth < 67.5),
        ("distance", "10–20 m"): (far >= 10) & (far < 20),
        ("occlusion", "largely occluded"): table["visibility"] < 0.4,
        ("height", "1.75–2 m"): table["class"] == "Pedestrian",
    }.items():
        row = counts.loc[("all", by, name)]
        assert row["objects"] == bin_.sum() / 2
        assert row["second"] == pytest.approx((table["line"] & ~table["center"])[bin_].sum() / 2)
    order = counts.loc["all"].loc["direction"].index.tolist()
    names = ("left", "front left", "front", "front right", "right")
    assert order == [own for own in names if own in order]
    assert set(order) <= set(SECTORS)


def test_one_generalist_has_the_interval_of_its_individuals_and_routes(compared):
    """One seed, and each object its own route and individual: the jackknife is a t-test."""
    n = len(compared.objects)
    one = replace(
        compared, seeds=compared.seeds[:1], found=compared.found[:, :, :1], generalist=True
    )
    alone = compared.objects.assign(route=range(n), object_id=[*map(str, range(n))])
    one = replace(one, objects=alone)
    row = one.counts().iloc[0]
    difference = 100 * (one.found[0, :, 0].astype(float) - one.found[1, :, 0])
    first, second = np.count_nonzero(difference > 0), np.count_nonzero(difference < 0)
    # Bonett and Price's interval: one more pair of each kind.
    centre = (first - second) / (n + 2)
    variance = ((first + second + 2) / (n + 2) - centre**2) / (n + 2)
    half = 100 * np.sqrt(variance) * stats.t.ppf(0.975, n - 1)
    assert row["low"] == pytest.approx(100 * centre - half, abs=0.3)
    assert row["high"] == pytest.approx(100 * centre + half, abs=0.3)


def test_rigs_that_find_the_same_few_objects_may_differ(compared):
    alike = replace(compared, found=np.ones_like(compared.found[:, :, :1]), generalist=True)
    row = alike.counts().iloc[0]
    assert (row["first"], row["second"], row["difference"]) == (0, 0, 0)
    individuals = row[
        "individuals"
    ]  # without a difference in n, at most 3 / n by the rule of three
    assert row["low"] == pytest.approx(-row["high"])
    assert 2 < individuals * row["high"] / 100 < 6


def test_one_specialist_seed_has_no_interval(compared):
    one = replace(compared, seeds=(1,), found=compared.found[:, :, :1])
    assert one.counts()[["low", "high"]].isna().all(axis=None)


def test_frames_take_turns_and_show_no_individual_twice(compared):
    rows = compared.telling(8)
    lead = compared.shares[0] - compared.shares[1]
    assert [np.sign(lead[row]) for row in rows] == [1, -1] * 4
    pictured = compared.objects.iloc[rows]
    assert pictured["frame"].is_unique
    assert not pictured.duplicated(["scene", "object_id"]).any()
    worth = np.maximum(lead, 0) * compared.objects["visibility"]
    assert pictured["frame"].iloc[0] == worth.groupby(compared.objects["frame"]).sum().idxmax()
    assert replace(compared, found=np.ones_like(compared.found)).telling() == []


def test_points_in_a_box_have_the_colour_of_what_became_of_it():
    columns = ["x", "y", "z", "length", "width", "height", "yaw"]
    boxes = [[10, 0, 1, 4, 2, 2, np.pi / 2], [10, 9, 1, 4, 2, 2, 0]]
    objects = pd.DataFrame(boxes, columns=columns).assign(**{"class": "Car", "points": 3})
    # 1.9 m to the side is in the car that stands across, and beside the one that stands along.
    points = np.array([[10, 1.9, 1], [11.9, 0, 1], [10, 9, 1], [11.9, 9, 1], [10, 10.9, 1]])
    cloud = points.astype(np.float32)
    plot = frame_in_space(objects, np.array([1.0, 0.0]), cloud, np.empty((0, 8)))
    drawn = {
        trace.marker.color: sorted(zip(trace.x.tolist(), trace.y.tolist(), strict=True))
        for trace in plot.data
        if trace.mode == "markers" and trace.hovertext is None
    }
    near = ([(10, 1.9)], [], [(10, 9), (11.9, 9)])
    for colour, places in zip(FOUND.values(), near, strict=True):
        assert drawn[colour] == [pytest.approx(place) for place in places]


@pytest.fixture(scope="module")
def folder(made_up_run, tmp_path_factory) -> Path:
    """A report with frames of the rigs that it compares."""
    folder = tmp_path_factory.mktemp("failures") / "grid"
    shutil.copytree(made_up_run, folder)
    compared = Analysis(RunFolder.read(folder)).pair
    assert compared is not None
    pictured = compared.objects["object"].iloc[compared.telling(4)].tolist()
    objects = pd.read_parquet(folder / "objects.parquet").to_dict("records")
    frames = made_up_frames(np.random.default_rng(0), objects, compared.rigs, pictured)
    np.savez_compressed(folder / "failures.npz", **frames)
    sweep_json = json.loads((folder / SweepResult.FILE).read_text())
    sweep_json |= {"vehicle": [], "vehicle_mesh": SURFACE}
    (folder / SweepResult.FILE).write_text(json.dumps(sweep_json))
    report_of(folder, "failures")
    return folder


def test_the_page_shows_each_frame_under_both_rigs(folder):
    page = Page((folder / "failures.html").read_text(encoding="utf-8"))
    assert page.loads == []
    assert page.csp.startswith("default-src 'none'")
    frames = [json.loads(text) for tag, text in page.scripts if tag.get("class") == "frame"]
    assert [len(rigs) for rigs in frames] == [2] * 4
    arrays = np.load(folder / "failures.npz")
    drawn = sum(
        len(np.frombuffer(b64decode(trace["x"]["bdata"]), np.float32))
        for trace in frames[0][1]["data"]
        if trace["mode"] == "markers" and "hovertext" not in trace and trace["x"]
    )
    assert drawn == len(arrays["points/0/1"])
    (vehicle,) = (text for attributes, text in page.scripts if attributes.get("id") == "vehicle")
    surface = json.loads(vehicle)["data"][0]
    assert surface["type"] == "mesh3d"
    heights = np.frombuffer(b64decode(surface["z"]["bdata"]), np.float32)
    assert heights.tolist() == [z for _, _, z in SURFACE["vertices"]]
    compared = Analysis(RunFolder.read(folder)).pair
    assert page.tags.count("button") == 4 + 2
    assert all(f"{rig} finds it" in page.text for rig in compared.rigs)


def test_report_and_decision_say_the_same_and_lead_to_the_frames(folder):
    compared = Analysis(RunFolder.read(folder)).pair
    counts = pd.read_csv(folder / "tables" / "failures.csv")
    first, second = compared.rigs
    sentence = f"{first} finds {counts.iloc[0][f'{first} alone']:,.0f} that {second} misses"
    for name in ("report.html", "decision.html"):
        page = Page((folder / name).read_text(encoding="utf-8"))
        assert sentence in page.text
        assert "failures.html" in page.links
    assert "(failures.html)" in (folder / "report.md").read_text(encoding="utf-8")


def test_frames_of_other_rigs_are_not_shown(tmp_path):
    folder = write_run(tmp_path / "other", names=["a", "b"], seeds=(1,))
    with np.load(folder / "failures.npz") as arrays:
        np.savez(folder / "failures.npz", **dict(arrays) | {"rigs": np.array(["a", "c"])})
    report_of(folder, "failures")
    page = Page((folder / "failures.html").read_text(encoding="utf-8"))
    assert "button" not in page.tags
    assert "The uncertainty is unknown" in page.text


@pytest.mark.parametrize(
    ("name", "column", "value", "message"),
    [
        ("found", "object", 10**6, "1000000"),
        ("found", "points", None, ""),
        ("objects", "class", "Tram", "'Tram'"),
        ("objects", "object", 1, "1"),
    ],
)
def test_tables_that_do_not_fit_are_named(made_up_run, name, column, value, message):
    run = RunFolder.read(made_up_run)
    table = getattr(run, name)
    table[column] = table[column].astype(object)
    table.loc[0, column] = value
    with refused((f"{name}.parquet", column, message)):
        failures(run, next(groups(run)), ("center", "line"))


def test_an_older_run_folder_says_what_it_lacks(tmp_path):
    folder = write_run(tmp_path / "old", names=["a", "b"], seeds=(1,))
    for name in ("objects.parquet", "found.parquet", "failures.npz"):
        (folder / name).unlink()
    (folder / "failures.html").write_text("of an earlier run")
    page = Page(report_of(folder, "failures").read_text(encoding="utf-8"))
    assert "The run folder has no objects.parquet and no found.parquet." in page.text
    assert not (folder / "failures.html").exists()
