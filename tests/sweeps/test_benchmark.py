"""`lidarplace benchmark`: known numbers anew, all kinds of predictors, one line for a mistake."""

import sys
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest

from lidarplace.base.errors import InputError
from lidarplace.base.plugin_folders import PLUGINS
from sweeps.benchmark import predictors, rigs
from sweeps.benchmark.markdown import markdown_table
from sweeps.benchmark.predictors import BUILT_IN, predict
from sweeps.benchmark.rigs import HEADLINES, METRICS, built_in, populations, read
from sweeps.benchmark.scores import scores
from sweeps.commands.benchmark import app
from tests.sweeps.toy import call
from tracking.statistics.reliability import seed_mean

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "studies" / "findings"


@pytest.fixture
def study(monkeypatch):
    monkeypatch.syspath_prepend(str(STUDY))
    for name in ("benchmark", "candidates", "predicting", "distil", "properties"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    import benchmark

    return benchmark


@pytest.fixture
def two_rigs(monkeypatch):
    """Take two of the 41 rigs, so that a predictor takes seconds."""
    two = "grid.placement=[line, center]"
    monkeypatch.setattr(predictors, "trials", lambda own=(): rigs.trials([*own, two]))


def truth():
    columns = {}
    for metric in METRICS:
        values = rigs.of(read("reached"), metric)
        values = values.pivot(index="placement", columns="seed", values="value")
        columns[metric] = pd.Series(seed_mean(values.to_numpy()), values.index)
    return pd.DataFrame(columns)


def test_tables_of_the_package_are_those_of_the_study(study):
    for name, table in study.tables().items():
        pd.testing.assert_frame_equal(read(name), table)
    assert (rigs.FOLDER / "rigs.yaml").read_bytes() == (STUDY / "findings.yaml").read_bytes()
    one = study.generalists().set_index("placement")[list(METRICS)]
    pd.testing.assert_frame_equal(built_in()[0]["generalist"], one, check_exact=False)


def test_populations_are_all_rigs_once():
    counted = populations()
    origins = ("paper's", "random", "optimised", "other LiDARs")
    assert [len(counted[name]) for name in origins] == [8, 20, 5, 8]
    assert sorted(rig for name in origins for rig in counted[name]) == sorted(counted["all"])
    assert len(counted["same LiDARs"]) == 33


def test_what_the_package_has_of_predictors_is_what_they_say(two_rigs, study):
    stored, _ = built_in()
    assert set(stored) == {*BUILT_IN, *study.PEERS, "generalist", "pretrained"}
    for name in (
        "s_mig",
        "expected_recall",
        "perception_entropy",
        "expected_ap",
        "ground_uniformity",
    ):
        predicted = predict(study.PEERS.get(name, name))[0]
        expected = stored[name].loc[predicted.index]
        pd.testing.assert_frame_equal(predicted, expected, check_names=False, rtol=1e-9)


@pytest.mark.long
def test_the_weights_of_the_package_are_those_of_the_table(two_rigs):
    stored, _ = built_in()
    predicted = predict("pretrained")[0]
    # Points of percent; other processors round otherwise.
    difference = (predicted - stored["pretrained"].loc[predicted.index]).abs()
    assert difference.to_numpy().max() < 0.5


def test_the_truth_is_a_perfect_predictor_and_its_opposite_the_worst():
    predicted = {"truth": truth(), "opposite": -truth()}
    table = scores(predicted, (*HEADLINES, "Cyc. AP")).set_index("predictor")
    assert table.loc["truth", "rho"].to_numpy() == pytest.approx(1.0)
    assert table.loc["opposite", "rho"].to_numpy() == pytest.approx(-1.0)
    with_pairs = table[table["pairs"] > 0]
    assert (with_pairs.loc["truth", "right"] == 1).all()
    assert (with_pairs.loc["opposite", "right"] == 0).all()
    lost = table["regret"].to_numpy().reshape(-1, 2)  # of both, by turns
    assert (lost[:, 0] <= lost[:, 1]).all()


def test_a_predictor_without_a_value_for_a_metric_has_no_number_there():
    one = truth().assign(**{"recall of all": np.nan, "Cyc. AP": 1.0})
    metrics = ("recall of all", "Cyc. AP", "Car AP over IoU")
    table = scores({"one": one}, metrics).set_index(["metric", "population"])
    without = table.loc[["recall of all", "Cyc. AP"], ["rho", "low", "regret"]]
    assert without.isna().all(axis=None)
    assert np.isfinite(table.loc["Car AP over IoU", "rho"]).all()


MODULE = """
from math import nan
heights = lambda placement, log: sum(mount.z for mount in placement.mounts)
def by_class(placement, log):
    assert set(log.frames["split"]) == {"train"}
    return {"Car": placement.mounts[0].z, "all": placement.mounts[1].z}
constant = lambda placement, log: 1.5
nothing = lambda placement, log: None
words = lambda placement, log: "good"
unknown = lambda placement, log: nan
boundless = lambda placement, log: 10**400
truck = lambda placement, log: {"Truck": 1.0}
def fails(placement, log):
    return 1 / 0
number = 3
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "placing_own.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "placing_own", raising=False)
    with patch.dict(PLUGINS, clear=True):
        yield
    sys.modules.pop("placing_own", None)


def test_a_function_of_ones_own(module, two_rigs):
    predicted = predict("placing_own:heights")[0]
    assert predicted.loc["center"].nunique() == 1
    assert predicted.loc["line", "Car AP @ 0.7"] == pytest.approx(4 * 2.2)
    predicted = predict("placing_own:by_class")[0]
    assert predicted[["Ped. AP", "Cyc. AP"]].isna().all(axis=None)
    assert predicted["recall of all"].notna().all()


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("constant", "the same number for all rigs"),
        ("nothing", "rig line: Car: wrong value; expected one finite real number, found None"),
        ("words", "found 'good'"),
        ("unknown", "found nan"),
        ("boundless", "found 1000000"),
        ("truck", "found 'Truck'"),
        ("fails", "/placing_own.py:14: ZeroDivisionError: division by zero"),
        ("number", "wrong type; expected one of lidarplace.predictors, found int"),
        ("absent", "cannot be imported"),
    ],
)
def test_a_wrong_function_is_one_line(module, two_rigs, name, told):
    with pytest.raises(InputError) as error:
        predict(f"placing_own:{name}")
    assert told in str(error.value)
    assert "\n" not in str(error.value)


def test_a_generalist_is_judged_on_the_test_frames(tmp_path, two_rigs, monkeypatch):
    torch = pytest.importorskip("torch")
    from training import build_detector
    from training.checkpoints import write_checkpoint

    torch.manual_seed(0)
    classes = ("Car", "Cyclist", "Pedestrian")
    rig = rigs.trials(["detector=pointpillars_tiny"])["line"]
    crop = rig.evaluate.stage.point_range
    model = build_detector("pointpillars_tiny", classes, point_range=crop)
    write_checkpoint(tmp_path / "g.pt", model.state_dict(), "pointpillars_tiny", classes)
    log = rigs.log_of("test")
    few = log.frames.iloc[::400]
    log = type(log)(log.boxes[log.boxes["frame"].isin(few["frame"])], few, log.buildings)
    monkeypatch.setattr(predictors, "log_of", lambda split: log)
    of_rig, trials = predictors.resolved(str(tmp_path / "g.pt"))
    assert {*of_rig(trials["line"])} == {*METRICS}
    errors = trials["line"].evaluate.inputs[1].stage.errors
    assert (errors.offset, errors.angle) == (0.01, pytest.approx(np.radians(0.5)))


def test_what_the_command_prints(module, monkeypatch):
    few = {name: populations()[name] for name in ("random", "all")}
    for name in ("scores", "markdown"):
        monkeypatch.setattr(f"sweeps.benchmark.{name}.populations", lambda: few)
    result = call(app, "placing_own:heights", env={"COLUMNS": "200"})
    assert result.output.count("| placing_own:heights |") == 4


def test_tables_of_the_page_are_what_the_command_prints():
    page = (ROOT / "docs" / "benchmark.md").read_text(encoding="utf-8")
    values, seconds = built_in()
    computed = scores(values, HEADLINES)
    for metric in HEADLINES:
        assert f"### {metric}\n\n{markdown_table(computed, seconds, metric)}\n" in page
