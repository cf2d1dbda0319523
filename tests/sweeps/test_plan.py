from collections import Counter
from pathlib import Path

import pytest
import yaml

from sweeps.grid import ConfigError, read_sweep
from sweeps.plan import make_plan


def plan_of(folder: Path, **changes):
    path = folder / "grid.yaml"
    path.write_text(yaml.safe_dump({"placement": "line"} | changes))
    return make_plan(read_sweep(path))


def stages(plan):
    return Counter(task.stage for task in plan.tasks)


def test_a_stage_runs_once_for_points_that_agree_in_what_it_depends_on(tmp_path):
    plan = plan_of(
        tmp_path,
        grid={"placement": ["line", "center"], "training.lr": [0.01, 0.02], "seed": [1, 2]},
    )
    assert stages(plan) == {
        "scene": 1,
        "ground_truth": 1,
        "pog": 1,
        "surrogates": 2,
        "accuracy": 2,
        "sampling_error": 2,
        "collect": 4,  # train and test
        "finetune": 8,
        "evaluate": 8,
    }


def test_a_finer_grid_trains_nothing_again(tmp_path):
    found = stages(plan_of(tmp_path, grid={"surrogate.resolution": [0.1, 0.2]}))
    assert (found["pog"], found["surrogates"]) == (2, 2)
    assert (found["scene"], found["collect"], found["finetune"]) == (1, 2, 1)


def test_another_density_is_another_scene(tmp_path):
    found = stages(plan_of(tmp_path, grid={"scene.density": [40, 80]}))
    assert (found["scene"], found["collect"], found["finetune"]) == (2, 4, 2)


def test_tasks_stand_after_their_inputs(tmp_path):
    seen = set()
    for task in plan_of(tmp_path, grid={"placement": ["line", "center"], "seed": [1, 2]}).tasks:
        assert all(needed.key in seen for needed in task.inputs)
        seen.add(task.key)


def test_keys_depend_on_content_alone(tmp_path):
    mounts = [{"x": 0, "y": y, "z": 2.2} for y in (0.6, 0.4, -0.4, -0.6)]
    same = {"placements": {"mine": {"mounts": mounts}}, "grid": {"placement": ["line", "mine"]}}
    plan = plan_of(tmp_path, **same)
    assert stages(plan)["collect"] == 2, "the same mounts under two names"
    assert len({trial.key for trial in plan.trials}) == 2
    again = plan_of(tmp_path, **same)
    assert [t.key for t in again.tasks] == [t.key for t in plan.tasks]


def test_further_axes_are_in_the_trials_name(tmp_path):
    plan = plan_of(tmp_path, grid={"scene.density": [40], "seed": [3]})
    assert plan.trials[0].label == "line · pointpillars_tiny · seed 3 · scene.density=40"


def test_a_checkpoint_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match=r"training.checkpoint: .*none.pt: No such file"):
        plan_of(tmp_path, training={"checkpoint": str(tmp_path / "none.pt")})


def test_a_checkpoint_counts_by_its_content(tmp_path):
    checkpoint = tmp_path / "weights.pt"
    checkpoint.write_bytes(b"1")
    first = plan_of(tmp_path, training={"checkpoint": str(checkpoint)}).trials[0]
    checkpoint.write_bytes(b"2")
    second = plan_of(tmp_path, training={"checkpoint": str(checkpoint)}).trials[0]
    assert first.finetune.key != second.finetune.key
    assert first.collect_test.key == second.collect_test.key
