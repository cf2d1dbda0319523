import math
from collections import Counter, deque
from pathlib import Path

import pandas as pd
import pytest
import torch
import yaml

from lidarplace.files.tables import read_parquet
from lidarplace.rigs.weather import Weather
from sweeps.configuration.grid import read_sweep
from sweeps.execution.schedule import Schedule
from sweeps.plan.plan import make_plan
from sweeps.results.rig_cautions import MOST_NAMED, _percentages, rig_cautions
from tests.refused import refused
from tests.sweeps.small_log import write_small_log
from training import build_detector, device
from training.checkpoints import write_checkpoint


def plan_of(folder: Path, **changes):
    path = folder / "grid.yaml"
    path.write_text(yaml.safe_dump({"placement": "line"} | changes))
    return make_plan(read_sweep(path))


def stages(plan):
    return Counter(task.stage.name for task in plan.tasks)


def test_a_stage_runs_once_for_points_that_agree_in_what_it_depends_on(tmp_path):
    grid = {"placement": ["line", "center"], "training.lr": [0.01, 0.02], "seed": [1, 2]}
    plan = plan_of(tmp_path, grid=grid)
    # A town to train and one to test; clouds of both.
    twos = ("scene", "ground_truth", "surrogates", "recall", "accuracy", "sampling_error")
    of_clouds = {"collect": 4, "finetune": 8, "evaluate": 8}
    assert stages(plan) == dict.fromkeys(twos, 2) | {"pog": 1} | of_clouds
    seen = set()
    for task in plan.tasks:
        assert all(needed.key in seen for needed in task.inputs)
        seen.add(task.key)
    label = "line · pointpillars_tiny · seed 1 · training.lr=0.01"
    assert plan.trials[0].label == label


@pytest.mark.parametrize(
    ("axis", "values", "counts"),
    [
        ("surrogate.resolution", [0.1, 0.2], {"pog": 2, "surrogates": 2, "scene": 2, "collect": 2}),
        ("surrogate.detection_probability", [0.1, 0.2], {"surrogates": 2, "collect": 2}),
        ("scene.density", [40, 80], {"scene": 4, "collect": 4, "finetune": 2}),
    ],
)
def test_an_axis_makes_other_work_of_what_depends_on_it_alone(tmp_path, axis, values, counts):
    plan = plan_of(tmp_path, grid={axis: values})
    counts = {"finetune": 1} | counts
    assert {stage: stages(plan)[stage] for stage in counts} == counts
    assert len(plan.trials) == 2


def test_studies_are_of_placements_spread_over_the_grid(tmp_path):
    mounts = [{"x": 0, "y": 0, "z": 2 + i / 100} for i in range(100)]
    own = {f"p{i:02d}": {"mounts": [mount]} for i, mount in enumerate(mounts)}
    changes = {"placements": own, "grid": {"placement": [*own], "seed": [1, 2]}}

    def studied(plan):
        names = {
            trial.grid_point.point.placement: [task.stage.name for task in trial.studies]
            for trial in plan.trials
        }
        assert [*filter(None, names.values())] == [["accuracy", "sampling_error"]] * (
            sum(map(bool, names.values()))
        )
        return [placement for placement, studies in names.items() if studies]

    def among(count):
        return plan_of(tmp_path, **changes | {"grid": {"placement": [*own][:count]}})

    found = plan_of(tmp_path, **changes)
    assert stages(found)["accuracy"] == stages(found)["sampling_error"] == 12
    assert stages(found)["surrogates"] == 100
    assert studied(found) == [f"p{9 * i:02d}" for i in range(12)]
    assert studied(among(12)) == [*own][:12], "all of a small grid"
    assert studied(among(13)) == [*[*own][:11], "p12"]
    changes |= {"surrogate": {"studied_placements": 2}}
    fewer = plan_of(tmp_path, **changes)
    assert studied(fewer) == ["p00", "p99"]
    assert {t.key for t in fewer.tasks} < {t.key for t in found.tasks}, "results are shared"
    changes |= {"promote": [{"by": "expected_ig", "keep": 3}]}
    assert studied(plan_of(tmp_path, **changes)) == [*own], "whatever goes on"


def trained_and_evaluated(plan, workers):
    """Stages of trainings and evaluations as they end; each task takes as long as any."""
    schedule, running, ended = Schedule(plan.tasks, set()), deque(), []
    while True:
        while len(running) < workers and (task := schedule.next()) is not None:
            running.append(task)
        if not running:
            return ended
        task = running.popleft()
        schedule.finish(task)
        if task.stage.name in ("finetune", "pretrain", "evaluate"):
            ended.append(task.stage.name)


@pytest.mark.parametrize("workers", [1, 3])
def test_a_trial_ends_before_the_next_ones_are_trained(tmp_path, workers):
    grid = {"placement": ["line", "center", "square"], "seed": [1, 2]}
    ended = trained_and_evaluated(plan_of(tmp_path, grid=grid), workers)
    assert len(ended) == 12
    trained, evaluated = 0, 0
    for stage in ended:
        trained += stage == "finetune"
        evaluated += stage == "evaluate"
        assert trained - evaluated <= workers
    generalist = {"evaluator": "generalist", "generalist": FEW}
    ended = trained_and_evaluated(plan_of(tmp_path, grid=grid, **generalist), workers)
    assert ended.count("pretrain") == 2
    assert ended[:2] == ["pretrain", "evaluate"]


def test_keys_depend_on_content_alone(tmp_path):
    mounts = [{"x": 0, "y": y, "z": 2.2} for y in (0.6, 0.4, -0.4, -0.6)]
    same = {"placements": {"mine": {"mounts": mounts}}, "grid": {"placement": ["line", "mine"]}}
    plan = plan_of(tmp_path, **same)
    assert stages(plan)["collect"] == 2, "the same mounts under two names"
    assert len({trial.key for trial in plan.trials}) == 2
    again = plan_of(tmp_path, **same)
    assert [t.key for t in again.tasks] == [t.key for t in plan.tasks]


def write_tiny(path, classes):
    state = build_detector("pointpillars_tiny", classes).state_dict()
    write_checkpoint(path, state, "pointpillars_tiny", classes)


def test_a_checkpoint_counts_by_its_content(tmp_path):
    checkpoint = tmp_path / "weights.pt"
    write_tiny(checkpoint, ["Car"])
    settings = {"classes": ["Car"], "training": {"checkpoint": str(checkpoint)}}
    first = plan_of(tmp_path, **settings).trials[0]
    write_tiny(checkpoint, ["Car"])  # other random weights
    second = plan_of(tmp_path, **settings).trials[0]
    assert first.finetune.key != second.finetune.key
    assert [task.key for task in first.collect_test] == [task.key for task in second.collect_test]
    with refused(("", "training.checkpoint", ""), "other classes"):
        plan_of(tmp_path, **settings | {"classes": ["Car", "Cyclist"]})


def inputs_of(task, stage):
    return [needed for needed in task.inputs if needed.stage.name == stage]


def test_every_simulation_is_a_task_and_training_sees_those_of_its_split(tmp_path):
    towns = {"towns": ["generated", "generated"], "routes": 4, "egos_per_run": 2, "test_routes": 1}
    plan = plan_of(tmp_path, scene=towns)
    assert stages(plan)["scene"] == 2 * 2 + 2
    trial = plan.trials[0]
    assert len(trial.pog.inputs) == len(inputs_of(trial.finetune, "collect")) == 4
    for task, split, count in ((trial.finetune, "train", 4), (trial.evaluate, "test", 2)):
        clouds, truths = inputs_of(task, "collect"), inputs_of(task, "ground_truth")
        assert {cloud.stage.split for cloud in clouds} == {split}
        assert len(clouds) == len(truths) == count
        assert [c.inputs for c in clouds] == [t.inputs for t in truths], "in the same order"


def test_with_the_papers_split_every_simulation_trains_and_tests(tmp_path):
    scene = {"split": "paper", "routes": 2, "test_routes": 0}
    plan = plan_of(tmp_path, scene=scene)
    assert stages(plan)["scene"] == 1
    trial = plan.trials[0]
    (train,), (test,) = inputs_of(trial.finetune, "collect"), inputs_of(trial.evaluate, "collect")
    assert train.inputs == test.inputs == trial.scenes
    assert (train.stage.split, test.stage.split) == ("train", "test")
    two = plan_of(tmp_path, scene=scene | {"towns": ["generated"] * 2})
    assert trial.scenes[0].key == two.trials[0].scenes[0].key, "another town leaves it as it is"


def test_quirks_change_the_clouds_alone(tmp_path):
    quirks = {"tilt_in_degrees": True, "misaligned_heights": True}
    plain, odd = (
        plan_of(tmp_path, placement="pyramid_roll", lidar=lidar).trials[0] for lidar in ({}, quirks)
    )
    assert plain.surrogates.key == odd.surrogates.key
    (collect,), (straight,) = odd.collect_test, plain.collect_test
    tilted, meant = collect.stage.placement.mounts, straight.stage.placement.mounts
    assert [(m.x, m.y, m.z) for m in tilted] == [(m.x, m.y, m.z) for m in meant]
    rolls = [(a.roll, b.roll) for a, b in zip(tilted, meant, strict=True)]
    assert all(a == pytest.approx(math.radians(b)) for a, b in rolls)
    assert {b for _, b in rolls} == {-0.28, 0.0, 0.28}
    assert collect.stage.crop[2] == pytest.approx(straight.stage.crop[2] - 0.4)


def test_thinned_clouds_leave_the_surrogates_as_they_are(tmp_path):
    sparse = {"azimuth_steps": 5625, "cloud_share": 0.16}
    whole, thin = (
        plan_of(tmp_path, lidar=lidar).trials[0] for lidar in ({"azimuth_steps": 5625}, sparse)
    )
    assert whole.surrogates.key == thin.surrogates.key
    assert [task.key for task in whole.studies] == [task.key for task in thin.studies]
    for (task,), steps in ((whole.collect_test, 5625), (thin.collect_test, 900)):
        assert {lidar.azimuth_steps for lidar in task.stage.placement.lidars} == {steps}


def test_a_log_of_ones_own(tmp_path):
    write_small_log(tmp_path / "log")
    log = {"scene": {"source": "log", "folder": str(tmp_path / "log")}, "classes": ["Car"]}
    plan = plan_of(tmp_path, **log)
    assert (stages(plan)["scene"], stages(plan)["collect"]) == (1, 2)
    frames = pd.read_parquet(tmp_path / "log/frames.parquet")
    frames.assign(route=range(4)).to_parquet(tmp_path / "log/frames.parquet")
    again = plan_of(tmp_path, **log)
    assert plan.trials[0].scenes[0].key != again.trials[0].scenes[0].key, "content counts"


def test_more_placements_read_no_more_of_a_log(tmp_path, monkeypatch):
    write_small_log(tmp_path / "log")
    read, reads = [], []
    monkeypatch.setattr(
        "lidarplace.logs.box_log.read_parquet",
        lambda *a, **k: read.append(a) or read_parquet(*a, **k),
    )
    scene = {"source": "log", "folder": str(tmp_path / "log")}
    for placements in (["line", "center"], ["line", "center", "pyramid", "trapezoid"]):
        read.clear()
        plan = plan_of(tmp_path, scene=scene, classes=["Car"], grid={"placement": placements})
        assert {t.grid_point.point.scene.frame_counts() for t in plan.trials} == {(3, 1)}
        reads.append(len(read))
    assert reads[0] >= reads[1], "a log is checked once"


def test_weather_is_seen_by_clouds_and_surrogates_alone(tmp_path):
    air = {"visibility": 100, "rain": 5}
    plan = plan_of(tmp_path, placement="center", grid={"weather": [{}, air]})
    counts = {"pog": 1, "scene": 2, "ground_truth": 2, "collect": 4, "surrogates": 2, "recall": 2}
    assert {stage: stages(plan)[stage] for stage in counts} == counts
    clear, dim = (
        {task.key for task in plan.tasks if trial_weather(task) == weather}
        for weather in (0.0, Weather(100.0, 5.0).extinction(905e-9))
    )
    assert {task.key for task in plan_of(tmp_path, placement="center").tasks} >= clear
    assert len(clear) == len(dim)
    axis = plan_of(tmp_path, placement="center", grid={"weather.visibility": [50, None]})
    assert axis.trials[1].surrogates.key in clear


def trial_weather(task):
    """Extinction of the rig that a task knows."""
    rig = getattr(task.stage, "placement", None)
    return None if rig is None else rig.lidars[0].extinction


EIGHT = ["line", "center", "trapezoid", "square", "line_roll", "pyramid", "pyramid_roll"]
FEW = {"rigs": 6, "rigs_per_frame": 2, "epochs": 3}


def test_a_generalist_is_trained_once_on_rigs_that_it_does_not_judge(tmp_path):
    grid = {"placement": EIGHT, "evaluator": ["generalist"], "seed": [1, 2]}
    plan = plan_of(tmp_path, generalist=FEW, training={"epochs": 9}, grid=grid)
    assert stages(plan)["pretrain"] == 2
    assert "finetune" not in stages(plan)
    judged = {task.stage.placement.mounts for trial in plan.trials for task in trial.collect_test}
    for trial in plan.trials:
        training = trial.evaluate.inputs[0]
        assert training.stage.name == "pretrain"
        assert training.stage.seed == trial.grid_point.point.seed
        assert training.stage.training.epochs == 3
        collected = [task.stage for task in training.inputs if task.stage.name == "collect"]
        assert len({params.placement.mounts for params in collected}) == 6
        assert not {params.placement.mounts for params in collected} & judged
        assert {params.split for params in collected} == {"train"}
        frames = Counter(f for own in collected for f in range(30)[own.first :: own.every])
        assert set(frames.values()) == {2}  # each frame under so many rigs


def test_a_generalist_is_shared_by_sweeps_and_by_those_who_start_from_it(tmp_path):
    grid = {"placement": ["line", "center"], "evaluator": ["generalist", "specialist", "finetuned"]}
    plan = plan_of(tmp_path, generalist=FEW, grid=grid)
    assert stages(plan)["pretrain"] == 1
    (generalist,) = [task for task in plan.tasks if task.stage.name == "pretrain"]
    tuned = [t for t in plan.trials if t.grid_point.point.evaluator == "finetuned"]
    assert [trial.finetune.inputs[0] for trial in tuned] == [generalist] * 2
    own = [t for t in plan.trials if t.grid_point.point.evaluator == "specialist"]
    assert all(task.stage.name != "pretrain" for trial in own for task in trial.finetune.inputs)
    other = {"training": {"epochs": 2}, "scene": {"test_seed": 5}}
    grid = {"placement": ["center", "line"]}
    same = plan_of(tmp_path, generalist=FEW, evaluator="generalist", grid=grid, **other)
    assert generalist.key in {task.key for task in same.tasks}
    assert not {trial.evaluate.key for trial in same.trials} & {task.key for task in plan.tasks}


def test_a_generalist_s_rigs_can_be_named(tmp_path):
    own = {f"own_{z}": {"mounts": [{"x": 0, "y": 0, "z": z}]} for z in (2, 3)}
    changes = {"placements": own, "evaluator": "generalist"}
    plan = plan_of(tmp_path, generalist={"rigs": list(own)}, **changes)
    (training,) = [task for task in plan.tasks if task.stage.name == "pretrain"]
    found = [task.stage for task in training.inputs if task.stage.name == "collect"]
    assert {params.placement.mounts[0].z for params in found} == {2, 3}
    assert {params.every for params in found} == {1}


def test_a_generalist_has_the_lidar_model_that_it_judges(tmp_path):
    own = {"own": {"mounts": [{"x": 0, "y": 0, "z": 2, "lidar": {"beams": 64}}]}}
    changes = {"placements": own, "generalist": {"rigs": ["own"]}}
    assert stages(plan_of(tmp_path, **changes))["pretrain"] == 0
    assert stages(plan_of(tmp_path, evaluator="generalist", lidar={"beams": 64}, **changes))


def test_a_vehicle_of_the_fleet_is_what_is_tested_and_not_what_is_trained_on(tmp_path):
    errors = {"offset": 0.01, "angle_deg": 0.5}
    grid = {"placement": ["line", "square"], "mounting_errors.vehicle": [1, 2]}
    plan = plan_of(tmp_path, mounting_errors=errors, grid=grid)
    assert (stages(plan)["finetune"], stages(plan)["evaluate"]) == (2, 4)
    clouds = {trial.label: trial.collect_test[0].stage for trial in plan.trials}
    assert len({params.placement for params in clouds.values()}) == 4
    assert not any(params.errors for params in clouds.values())
    fleet = [task.stage for task in plan.trials[0].finetune.inputs if task.stage.name == "collect"]
    assert all(params.errors for params in fleet)


def test_a_rig_whose_rings_coincide_is_told_how_they_would_not(tmp_path):
    grid = {"placement": ["line", "center"], "evaluator": ["generalist", "specialist"]}
    plan = plan_of(tmp_path, generalist=FEW, grid=grid)
    line = [t for t in plan.trials if t.grid_point.point.placement == "line"]
    center = [t for t in plan.trials if t.grid_point.point.placement == "center"]
    assert all(trial.interleaving is None for trial in center)
    found = line[0].interleaving
    assert [round(math.degrees(pitch), 9) for pitch in found.pitches] == [-0.75, -0.25, 0.25, 0.75]
    assert found.after < found.before - 0.1
    assert found.placement.mounts != line[0].grid_point.rig.mounts


def test_cautions_name_rigs_beyond_what_the_generalist_has_seen(tmp_path):
    high = {"high": {"mounts": [{"x": 0, "y": y, "z": 2.2} for y in (-0.6, -0.2, 0.2, 0.6)]}}
    named = {f"p{z}": {"mounts": [{"x": 0, "y": y, "z": z} for y in range(4)]} for z in (1, 2)}
    generalist = {"evaluator": "generalist", "generalist": {"rigs": list(named)}}
    rigs = {"placements": high | named, "placement": "high", "vehicle": []}
    plan = plan_of(tmp_path, **generalist, **rigs)
    coincide, facing, outside = rig_cautions(plan)
    pairs = "high (1 and 2, 5 pairs more)"
    assert facing.startswith(f"LiDARs look into each other in 1 rig: {pairs}. ")
    assert coincide.startswith("Rings of LiDARs coincide in 1 rig: high (")
    assert "pitches of −0.75, −0.25, +0.25, +0.75 degrees" in coincide
    assert outside.endswith("in 1 rig: high (y by 0.60 m, z by 0.20 m).")


def test_cautions_name_lidars_that_see_little_or_the_vehicle(tmp_path):
    """The ROI is in front: a view of 60 degrees to the rear meets its first half metre alone."""
    rear = {"beams": 16, "elevation_deg": [-25, 5], "azimuth_deg": [-30, 30]}
    mounts = {
        "roof": [{"x": 0, "y": 0, "z": 2.2}, {"x": 0, "y": 0, "z": 1.52}],
        "back": [{"x": 0, "y": 0, "z": 2.2}, {"x": -1, "y": 0, "z": 2.8, "yaw_deg": 180}],
    }
    mounts["back"][1]["lidar"] = rear
    own = {name: {"mounts": own} for name, own in mounts.items()}
    swept = {"placements": own, "grid": {"placement": list(own)}, "allow_blind_lidars": True}
    plan = plan_of(tmp_path, **swept, detector=None)
    back, roof = rig_cautions(plan)
    assert back == "LiDARs cover less than 1 % of the ROI in 1 rig: back (LiDAR 2: 0 %)."
    assert roof.endswith("more than 25 % of the rays of LiDARs in 1 rig: roof (LiDAR 2: 75 %).")


def test_shares_have_two_digits_without_powers_of_ten():
    assert _percentages({1: 0.999, 2: 0.7549, 3: 0.00012}) == (
        "LiDAR 1: 100 %, LiDAR 2: 75 %, LiDAR 3: 0.012 %"
    )


def test_of_many_rigs_whose_rings_coincide_those_with_the_most_are_named(tmp_path):
    rigs = {
        f"apart_{n}": {"mounts": [{"x": 0, "y": 0.4 * i, "z": 2 + 0.004 * n * i} for i in range(4)]}
        for n in range(12)
    }
    plan = plan_of(tmp_path, placements=rigs, grid={"placement": list(rigs)}, detector=None)
    coincide, facing = rig_cautions(plan)
    known = [trial for trial in plan.trials if trial.interleaving is not None]
    shares = {trial.grid_point.point.placement: trial.interleaving.before for trial in known}
    most = sorted(shares, key=lambda name: -shares[name])[:MOST_NAMED]
    named = [f"{name} ({100 * shares[name]:.0f} %)" for name in most]
    more = len(shares) - MOST_NAMED
    assert more > 0
    expected = (
        f"Rings of LiDARs coincide in {len(shares)} rigs: {', '.join(named)} and {more} more. "
    )
    assert coincide.startswith(expected)
    assert facing.startswith("LiDARs look into each other in ")


def test_16_bits_are_another_result_and_a_processor_without_them_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(device, "device", lambda: torch.device("cpu"))
    half = {"training": {"mixed_precision": "everywhere"}}
    for has, cautions in ((True, ()), (False, (device.NO_BFLOAT16,))):
        monkeypatch.setattr(device, "cpu_has_bfloat16", lambda has=has: has)
        plan, plain = plan_of(tmp_path, **half), plan_of(tmp_path)
        assert (plan.cautions, plain.cautions) == (cautions, ())
        assert plan_of(tmp_path, detector=None, **half).cautions == ()
        (odd,), (even,) = plan.trials, plain.trials
        assert odd.finetune.key != even.finetune.key
        assert odd.evaluate.key != even.evaluate.key
        assert odd.surrogates.key == even.surrogates.key


def test_cameras_are_said_to_be_ignored_and_change_no_key(tmp_path):
    """Clouds and detectors are the same with them; requirements alone know them."""
    mounts = {"mounts": [{"x": 0, "y": 0, "z": 2.2}]}
    people = {"name": "x", "where": {"x": [3, 5], "y": [0, 1]}, "what": "Pedestrian"}
    people |= {"at_least": {"pixels": 5}, "step": 1.0}
    camera = {"x": 1, "z": 1.5, "model": "a2d2_front_camera"}
    plans = [
        plan_of(tmp_path, placements={"mine": own}, placement="mine", requirements=[people])
        for own in (mounts, mounts | {"cameras": [camera]})
    ]
    keys = [{task.stage.name + task.label: task.key for task in plan.tasks} for plan in plans]
    assert {name for name in keys[0] if keys[0][name] != keys[1][name]} == {
        name for name in keys[0] if name.startswith("requirements")
    }
    said = "mine: cameras and radars (1) make no clouds: detectors and surrogates ignore them."
    assert [said in plan.cautions for plan in plans] == [False, True]
