"""Subsets of the rig that recorded a log as placements: on its real points, and simulated."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml

from lidarplace.clouds.clouds import PointClouds, read_clouds, write_clouds
from lidarplace.clouds.recorded import recorded_clouds
from lidarplace.logs.box_log import read_box_log, write_box_log
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.recorded import RecordedRig, one_rig
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import make_plan
from sweeps.results.rigs import lidar_models, rigs_yaml
from sweeps.stages.collect import CollectStage, RecordedCloudsStage
from tests.other_simulator import LIDAR, MOUNTS, RIG, write_log
from tests.refused import refused
from tests.sweeps.small_log import SMALL
from tests.sweeps.toy import ran
from tracking.report.sections.recorded_clouds import side_by_side
from tracking.run_folders.sweep import RunFolder

pytestmark = pytest.mark.usefixtures("one_thread")

CROP = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)
SUBSETS = {"only_low": ["low"], "both": ["low", "top"]}
SWEEP = SMALL | {
    "placements": {name: {"recorded": lidars} for name, lidars in SUBSETS.items()},
    "lidar": {"azimuth_steps": 90},
    "surrogate": SMALL["surrogate"] | {"names": ["covered_entropy", "expected_recall"]},
    "grid": {"placement": list(SUBSETS), "scene.clouds": ["recorded", "simulated"]},
}


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("other") / "log"
    write_log(folder, frames=2)
    return folder


def read(log, tmp_path, **changes):
    path = tmp_path / "grid.yaml"
    scene = {"source": "log", "folder": str(log)} | changes.pop("scene", {})
    own = {"scene": scene, "output": str(tmp_path / "runs")}
    path.write_text(yaml.safe_dump(SWEEP | own | changes))
    sweep = read_sweep(path)
    return sweep, make_plan(sweep)


def test_a_subset_has_exactly_the_points_of_its_lidars(log):
    folder, frames = log / "clouds" / "recorded", np.arange(4)
    whole = recorded_clouds(folder, frames, CROP)
    assert whole.counts.shape == (4, 2)
    assert (whole.counts > 100).all()
    for kept in ([0], [1], [0, 1]):
        own = recorded_clouds(folder, frames, CROP, kept)
        assert own.counts.tolist() == whole.counts[:, kept].tolist()
        for index in range(4):
            expected = whole[index][np.isin(whole.lidar(index), kept)]
            np.testing.assert_array_equal(own[index], expected)


def test_a_sweep_on_real_points_and_on_simulated_ones(log, tmp_path):
    sweep, _ = read(log, tmp_path)
    plan, store, folder = ran(sweep, tmp_path)
    parts = [read_clouds(path) for path in sorted((log / "clouds" / "recorded").iterdir())]
    assert [trial.grid_point.point.placement for trial in plan.trials[::2]] == list(SUBSETS)
    for trial in plan.trials:
        point = trial.grid_point.point
        named = [name for name in RIG.names if name in SUBSETS[point.placement]]
        assert trial.grid_point.rig.mounts == tuple(MOUNTS[name] for name in named)
        assert trial.grid_point.rig.lidars == (LIDAR,) * len(named), "not those of the key lidar"
        (task,) = trial.collect_test
        clouds = store.load(task)
        real = point.scene.clouds == "recorded"
        assert isinstance(task.stage, RecordedCloudsStage if real else CollectStage)
        assert clouds.counts.shape == (2, len(named))
        if real:  # the test route is the second folder; its ROI is in front
            for index in range(2):
                points = parts[1][index]
                inside = ((points[:, :3] >= CROP[:3]) & (points[:, :3] <= CROP[3:])).all(axis=1)
                of = np.isin(parts[1].lidar(index), [RIG.names.index(name) for name in named])
                assert clouds.counts[index].sum() == (inside & of).sum() > 100
        recall = store.load(trial.evaluate).metrics.query("metric == 'recall'")["value"]
        assert recall.between(0, 100).all()
    by = {(t.grid_point.point.placement, t.grid_point.point.scene.clouds): t for t in plan.trials}
    for name in SUBSETS:
        real, simulated = by[name, "recorded"], by[name, "simulated"]
        assert real.evaluate.key != simulated.evaluate.key
        values = [store.load(trial.recall).table["value"].tolist() for trial in (real, simulated)]
        assert values[0] == values[1], "surrogates are of the rig, whatever its clouds"
    assert len({trial.evaluate.key for trial in plan.trials}) == 4
    run = RunFolder.read(folder)
    pairs = side_by_side(run)
    assert set(pairs["placement"]) == set(SUBSETS)
    assert pairs[["recorded", "simulated"]].notna().all(axis=None)
    seen = run.points.pivot_table(index="placement", columns="scene.clouds", values="mean")
    assert (seen.loc["only_low"] < seen.loc["both"]).all(), "not the points of the whole rig"
    assert lidar_models(sweep)["both"][0].name is None
    written = yaml.safe_load(rigs_yaml(sweep))["placements"]["both"]["mounts"]
    assert [mount["name"] for mount in written] == ["top", "low"]
    assert written[1]["x"] == 2.6
    assert written[0]["lidar"]["azimuth_steps"] == LIDAR.azimuth_steps


def test_a_correction_is_that_of_each_lidar_by_its_name(log, tmp_path):
    shares = [0.0] * 6 + [1.0] * 66
    content = {"factor": {"other": 0.6}, "lidars": {"low": {"mask": {"azimuth_deg": 5}}}}
    content["lidars"]["low"]["mask"]["shares"] = shares
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(content))
    sweep, _ = read(log, tmp_path, lidar={"correction": "mine.yaml"})
    rigs = {own.point.placement: own.rig for own in sweep.points}
    top, low = rigs["both"].lidars
    assert (top.correction.mask, top.correction.factor) == (None, (("other", 0.6),))
    assert low.correction.mask.shares == (tuple(shares),)
    assert rigs["only_low"].lidars == (low,)
    written = yaml.safe_load(rigs_yaml(sweep))["placements"]["both"]["mounts"]
    assert "unit" not in written[0]["lidar"]
    assert written[1]["lidar"]["unit"] == "low"


RECORDED = {"clouds": "recorded"}
ONE = {"placement": ["only_top"]}


@pytest.mark.parametrize(
    ("placement", "changes", "key"),
    [
        ({"recorded": ["tpo"]}, {}, "placements: only_top.recorded"),
        ({"recorded": ["top", "top"]}, {}, "placements.only_top.recorded"),
        ({"recorded": ["top"]}, {"weather": {"rain": 1}}, "weather"),
        ({"recorded": ["top"]}, {"evaluator": "generalist"}, "scene.clouds"),
    ],
)
def test_mistakes(log, tmp_path, placement, changes, key):
    own = {"placements": {"only_top": placement}, "scene": RECORDED, "grid": ONE}
    with refused(("", key, "")):
        read(log, tmp_path, **own, **changes)


def moved(millimetres=0.0, degrees=0.0):
    low = replace(MOUNTS["low"], x=2.6 + millimetres / 1000, yaw=np.radians(degrees))
    return RecordedRig(("top", "low"), Placement("other", [MOUNTS["top"], low], LIDAR))


@pytest.mark.parametrize(
    ("rigs", "message"),
    [
        ({}, r"rig\.json: no recorded rig; convert the log with its calibration"),
        ({"route 0": RIG}, r"rig\.json: scene route 1: "),
        (
            {"route 0": RIG, "route 1": moved(millimetres=12)},
            r"scenes route 0 and route 1 have LiDAR low in different places; .*found 12 mm",
        ),
        ({"route 0": RIG, "route 1": moved(degrees=359)}, r"found 0 mm and 1\.0 degrees"),
        (
            {"route 0": RIG, "route 1": replace(RIG, names=("top", "front"))},
            "have LiDARs of other names or models",
        ),
    ],
)
def test_a_log_without_one_rig_offers_no_subsets(log, tmp_path, rigs, message):
    folder = tmp_path / "log"
    table = read_box_log(log)
    boxes = table.boxes[[name for name in table.boxes if "points" not in name]]
    write_box_log(folder, replace(table, boxes=boxes, rigs=rigs))
    with refused(message):
        read(folder, tmp_path, grid=ONE)


def test_rigs_that_differ_as_calibrations_do_are_one():
    assert one_rig({"a": RIG, "b": moved(millimetres=9, degrees=0.4)}) is RIG


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        ((1, 0), "clouds/recorded: no point of LiDAR low in any cloud"),
        ((1,), "clouds/recorded/0: points of 1 LiDARs; expected 2, top, low; convert the log"),
        ((1, 1), "clouds/recorded: no cloud of frame 2, and of 1 more"),
        (None, "clouds/recorded: no recorded clouds"),
    ],
)
def test_clouds_without_a_lidar_are_refused(log, tmp_path, counts, message):
    folder = tmp_path / "log"
    shutil.copytree(log, folder, ignore=shutil.ignore_patterns("clouds"))
    if counts is not None:
        points = np.ones((sum(counts), 4), np.float32)
        clouds = PointClouds.from_frames([0, 1], [(points, counts)] * 2, CROP)
        write_clouds(folder / "clouds/recorded/0", clouds)
    with refused(("", "placement", ""), message):
        read(folder, tmp_path, scene=RECORDED, grid={"placement": ["only_low"]})
