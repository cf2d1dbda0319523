"""Rigs evaluated by weights in a file: `evaluator: pretrained`, in sweeps, searches and Python."""

import socket
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement, Roi
from lidarplace.clouds.collect import crop_for
from lidarplace.logs.box_log import read_box_log
from lidarplace.mounting.errors import MountingErrors
from sweeps.command_line import app
from sweeps.configuration.grid import read_sweep
from sweeps.execution.worker import _prepare_device, try_task
from sweeps.plan.plan import make_plan
from sweeps.search.problem.problem import read_problem
from sweeps.store.local import Store
from tests.mlflow_database import write_database
from tests.refused import refused
from tests.sweeps.small_log import write_small_log, write_sweep
from tests.sweeps.toy import call
from tracking.run_folders.search import SearchFolder
from training.checkpoints import read_checkpoint, save_checkpoint
from training.pretrained import Domain, domain_of, evaluate_rigs, read_generalist

pytestmark = pytest.mark.usefixtures("one_thread")

LIDAR = {"azimuth_steps": 240}
TRAINED = {
    "classes": ["Car", "Cyclist", "Pedestrian"],
    "lidar": LIDAR,
    "surrogate": {"names": ["covered_entropy"], "resolution": 0.4},
    "training": {"epochs": 4, "batch_size": 2},
    "grid": {"placement": ["center", "pyramid"], "lidar.azimuth_steps": [240, 480]},
}
ROI = Roi((0, 40), (-20, 20), (0, 4), 0.4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pretrained")
    write_database(folder / "runs/mlflow.db")
    path = write(folder, TRAINED)
    call(app, "pretrain", path, "--out", folder / "base.pt")
    return folder


def write(folder, content, **changes):
    name = "search.yaml" if "search" in content else "grid.yaml"
    return write_sweep(folder, name, **content | changes)


def evaluated_sweep(folder, **changes):
    """A sweep that is evaluated by the file."""
    training = {"checkpoint": str(folder / "base.pt")}
    grid = {"placement": ["line", "square"]}
    content = TRAINED | {"evaluator": "pretrained", "training": training, "grid": grid}
    return write(folder, content, **changes)


def test_the_file_says_what_it_was_trained_on(folder):
    domain = read_generalist(folder / "base.pt").domain
    assert domain.lidars == (4, 4)
    assert domain.beams == (16, 16)
    assert domain.rays == (4 * 16 * 240, 4 * 16 * 480)
    assert domain.height == (2.2, 3.0)
    assert (domain.x, domain.y, domain.z) == ((0, 40), (-20, 20), (-0.5, 4))
    assert domain.classes == ("Car", "Cyclist", "Pedestrian")


def test_a_sweep_trains_nothing_and_python_finds_the_same(folder):
    path = evaluated_sweep(folder)
    plan = make_plan(read_sweep(path))
    assert {task.stage.name for task in plan.tasks} >= {"pretrained", "evaluate"}
    assert not {"finetune", "pretrain", "probe"} & {task.stage.name for task in plan.tasks}
    call(app, "run", path)
    results = pd.read_parquet(folder / "runs" / "grid" / "results.parquet")
    lidar = replace(Lidar.paper(), azimuth_steps=240)
    rig = PAPER_PLACEMENTS["line"].each_lidar(lambda _: lidar)
    (table,) = evaluate_rigs([rig], folder / "log", ROI, weights=folder / "base.pt")
    same = table.merge(results[results["placement"] == "line"], on=["class", "metric", "iou"])
    same = same[same["difficulty_x"] == same["difficulty_y"]].dropna(subset=["value_x"])
    assert len(same) > 10
    assert same["value_x"].max() > 0
    assert (same["value_x"] == same["value_y"]).all()


def test_other_frames_of_a_log_than_those_of_the_split_decide_nothing(folder):
    log = read_box_log(folder / "log")
    tested = log.frames[log.frames["split"] == "test"]
    alone = replace(log, frames=tested, boxes=log.boxes[log.boxes["frame"].isin(tested["frame"])])
    assert 0 < len(alone.boxes) < len(log.boxes)
    rig, how = PAPER_PLACEMENTS["line"], {"weights": folder / "base.pt"}
    rig = rig.each_lidar(lambda lidar: replace(lidar, azimuth_steps=240, range_noise=0.02))
    (table,) = evaluate_rigs([rig], log, ROI, **how)
    assert table["value"].max() > 0
    pd.testing.assert_frame_equal(table, evaluate_rigs([rig], alone, ROI, split="", **how)[0])


def test_rigs_that_are_evaluated_together_have_their_values_alone(folder):
    model = replace(Lidar.paper(), azimuth_steps=240, range_noise=0.02)
    rigs = [PAPER_PLACEMENTS[name].each_lidar(lambda _: model) for name in ("line", "pyramid")]
    how = {"errors": MountingErrors(0.01, 0.01), "seed": 3, "weights": folder / "base.pt"}
    tables = evaluate_rigs(rigs, folder / "log", ROI, ("Car",), **how)
    assert not tables[0].equals(tables[1])
    for rig, table in zip(rigs, tables, strict=True):
        (alone,) = evaluate_rigs([rig], folder / "log", ROI, ("Car",), **how)
        pd.testing.assert_frame_equal(table, alone)
    assert evaluate_rigs([], folder / "log", ROI) == []


def test_other_weights_are_other_results(folder):
    content, _ = read_checkpoint(folder / "base.pt")
    key = next(name for name, value in content["model_state"].items() if value.is_floating_point())
    content["model_state"] = {**content["model_state"], key: content["model_state"][key] + 1}
    save_checkpoint(folder / "other.pt", content)

    def keys(name):
        path = evaluated_sweep(folder, training={"checkpoint": str(folder / name)})
        return {task.stage.name: task.key for task in make_plan(read_sweep(path)).tasks}

    one, other = keys("base.pt"), keys("other.pt")
    assert one["pretrained"] != other["pretrained"]
    assert one["evaluate"] != other["evaluate"]
    assert one["collect"] == other["collect"]


def test_a_file_without_what_it_was_trained_on_is_refused(folder):
    content, _ = read_checkpoint(folder / "base.pt")
    save_checkpoint(folder / "old.pt", {k: v for k, v in content.items() if k != "domain"})
    with refused((str(folder / "old.pt"), "", "")):
        read_generalist(folder / "old.pt")
    save_checkpoint(folder / "odd.pt", content | {"domain": content["domain"] | {"lidars": ["a"]}})
    with refused((str(folder / "odd.pt"), "", "")):
        read_generalist(folder / "odd.pt")


def search(folder, **changes):
    for name in ("search", "choice"):
        if not (folder / name).exists():
            write_small_log(folder / name, seed=len(name))
    zone = {"x": [-0.5, 0.5], "y": [-0.6, 0.6], "z": [2.2, 2.4], "standoff": None}
    settings = {"lidars": 4, "objective": "pretrained", "zones": {"roof": zone}, "trials": 3}
    traffic = {name: {"scene.test_folder": str(folder / name)} for name in ("search", "choice")}
    settings |= {"batch_size": 3, "greedy": None, "traffic": traffic}
    content = {k: v for k, v in TRAINED.items() if k != "grid"}
    content |= {"training": {"checkpoint": str(folder / "base.pt")}, "verify": None}
    return write(folder, content | {"robustness": {"draws": 2}, "search": settings | changes})


@pytest.mark.usefixtures("two_peers")
def test_a_search_is_evaluated_by_the_file(folder):
    path = search(folder)
    result = call(app, "search", path)
    assert "robustness: not computed: no objective is a surrogate" in result.output
    assert "pretrained.recall" in result.output
    assert (folder / "runs" / "search" / "search.html").exists()


@pytest.mark.usefixtures("two_peers")
def test_a_second_round_is_evaluated_by_weights_trained_near_the_best(folder):
    objective = "pretrained.recall and AP_R40_3D_mean.Car"
    item = {"objective": objective, "trials": 5, "adapt": 3, "families": 3}
    models = {"coarse": LIDAR, "fine": {"azimuth_steps": 480}}
    path = search(folder, **item, models=models)
    small = ["--set", "name=rounds", "--set", "generalist={rigs: 3, rigs_per_frame: 1, epochs: 1}"]
    command = ["search", str(path), *small, "--set", "roi={x: [0, 40], y: [-20, 20], z: [0, 4]}"]
    call(app, *command)
    first, second = (SearchFolder.read(folder / "runs" / n) for n in ("rounds_first", "rounds"))
    assert [len(run.trials) for run in (first, second)] == [3, 2]
    assert first.search.first.name == objective
    assert second.search.first.name == objective.replace("pretrained", "generalist")
    best = [rig for rig in first.search.rigs.values() if rig.role == "found"]
    begun = [second.rig_of(trial) for _, trial in second.trials.iterrows()]
    for rigs in zip(begun, best[:2], strict=True):  # it starts from the best
        mounts = [np.round(rig.mounts, 3).tolist() for rig in rigs]
        assert mounts[0] == mounts[1]
        assert rigs[0].models == rigs[1].models
    assert {model for rig in best[:2] for model in rig.models} == {*models}
    stages = [folder / "runs" / "store" / stage for stage in ("pretrain", "detect")]
    before = {path: path.stat().st_mtime_ns for item in stages for path in item.glob("*")}
    call(app, *command)
    after = {path: path.stat().st_mtime_ns for item in stages for path in item.glob("*")}
    assert after == before, "the same command trains and evaluates nothing again"


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"lidars": 5}, "search", "rigs of the zones: "),
        ({"seeds": [1, 2]}, "search.seeds", "found 2"),
    ],
)
def test_a_search_outside_is_refused_before_it_begins(folder, changes, key, words):
    with refused(("", key, ""), words):
        read_problem(search(folder, **changes))


def test_a_domain_is_that_of_its_rigs():
    paper = Lidar.paper()
    low = Placement("low", [Mount(z=0.5)], lidar=paper)
    high = Placement("high", [Mount(z=2.0), Mount(x=1.0, z=3.0)], lidar=paper)
    crop = crop_for(ROI.x, ROI.y, ROI.z, low)
    domain = domain_of([low, high], crop, ("Car",))
    assert isinstance(domain, Domain)
    for rig in (low, high):
        assert domain.outside(rig, crop, ("Car",)) is None
    assert domain.outside(low, crop, ("Bus",)) == "class Bus; expected Car"
    above = Placement("above", [Mount(z=3.2)], lidar=paper)
    expected = "a LiDAR at a height of 3.2 m; expected 0.5 to 3"
    assert domain.outside(above, crop, ("Car",)) == expected
    pattern = Placement("livox", [Mount(z=2.0)], lidar=Lidar.named("mid70"))
    expected = "a LiDAR whose pattern does not repeat; expected beams that turn"
    assert domain.outside(pattern, crop, ("Car",)) == expected


def test_the_demo_and_its_search_fit_the_file_of_the_package():
    generalist = read_generalist()
    assert generalist.detector == "pointpillars_tiny"
    assert generalist.classes == ("Car", "Cyclist", "Pedestrian")
    assert all(torch.isfinite(value).all() for value in generalist.state_dict.values())
    examples = Path(__file__).parents[2] / "examples"
    plan = make_plan(read_sweep(examples / "demo.yaml"))
    trained = [task.stage for task in plan.tasks if task.stage.name == "finetune"]
    assert [params.checkpoint for params in trained] == 8 * [generalist.digest]
    problem = read_problem(examples / "search_demo.yaml")  # refuses rigs that it does not know
    assert problem.pretrained
    assert problem.space.zones[0].z == (1.6, 1.8)


def test_settings_of_a_training_decide_nothing_of_a_rig_that_is_not_trained_for(folder):
    def key(**training):
        path = evaluated_sweep(folder, training={"checkpoint": str(folder / "base.pt"), **training})
        return make_plan(read_sweep(path)).trials[0].evaluate.key

    assert key() == key(rotation=0.1, epochs=3, lr=0.1)
    assert key() != key(score_threshold=0.2)


def test_evaluations_on_a_gpu_have_other_keys(folder, card):
    """Of a GPU that networks can use: one that torch cannot use leaves the CPU's."""

    def keys(probe, **changes):
        card(probe)
        tasks = make_plan(read_sweep(evaluated_sweep(folder, **changes))).tasks
        return {task.key: task.stage.name for task in tasks}

    on_cpu, on_gpu = keys("print('cpu')"), keys("print('cuda')")
    assert {name for key, name in on_gpu.items() if key not in on_cpu} == {"evaluate"}
    assert keys("print('GPU: no driver')") == on_cpu
    assert keys("raise OSError('libcudart')") == on_cpu
    assert keys("print('cuda')", ray={"num_gpus": 0}) == on_cpu


@pytest.mark.parametrize(
    ("planned", "line"),
    [
        (True, "expected the GPU, found the CPU; ray.num_gpus=0 plans for the CPU"),
        (False, "expected the CPU, found the GPU; CUDA_VISIBLE_DEVICES= hides it"),
    ],
)
def test_a_result_of_another_device_than_planned_is_not_stored(
    folder, tmp_path, monkeypatch, planned, line
):
    other = torch.device("cpu" if planned else "cuda")
    monkeypatch.setattr("training.device.device", lambda: other)
    plan = make_plan(read_sweep(evaluated_sweep(folder)))
    evaluate = plan.trials[0].evaluate
    task = replace(evaluate, stage=replace(evaluate.stage, gpu=planned))
    assert task.stage.need().gpu_share == planned
    store = Store(tmp_path)
    failure = try_task(task, store, 0, 1.0).failure
    assert failure.reason == f"RuntimeError: {socket.gethostname()}: {line}"
    assert not failure.lasting
    assert not store.has(task)


def test_a_training_fails_on_an_assigned_gpu_that_is_full(monkeypatch):
    monkeypatch.setattr("training.device.device", lambda: torch.device("cpu"))
    monkeypatch.setattr("training.device.gpu_problem", lambda: "GPU: too little free memory")
    stage = SimpleNamespace(gpu=None)
    _prepare_device(stage, 1.0)  # the CPU was not assigned a GPU
    monkeypatch.setattr("ray.is_initialized", lambda: True)
    monkeypatch.setattr("ray.get_gpu_ids", lambda: [0])
    with pytest.raises(RuntimeError, match=r": GPU: too little free memory; ray\.num_gpus=0 "):
        _prepare_device(stage, 1.0)
