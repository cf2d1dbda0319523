"""A command as the evaluator: what it is given, what becomes of what it writes, and what fails."""

import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.clouds import PointClouds
from lidarplace.detections.read import COLUMNS
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.scenes.kitti.labels import label_lines, to_labels
from sweeps.command_line import app
from sweeps.commands.doctor import scenes
from sweeps.configuration.evaluator import EvaluatorCommand
from sweeps.plan.plan import read_plan
from sweeps.stages.command import CommandFailed, CommandStage
from sweeps.store.open import store_of
from tests.forked import Forked
from tests.mlflow_database import write_database
from tests.sweeps.small_log import SMALL, write_sweep
from tests.sweeps.toy import call
from training.kitti_ap import evaluate_boxes

# Copies result files from `truth`, after a look at what it was given.
TOY = """
import shutil, sys
from pathlib import Path
clouds, detections = map(Path, sys.argv[1:3])
tests = (clouds / "ImageSets/test.txt").read_text().split()
assert tests == ["000003"] and (clouds / "testing/velodyne/000003.bin").stat().st_size
assert len(list((clouds / "training/label_2").iterdir())) == 3
assert not (clouds / "testing/label_2").exists()
print("looked at", len(tests), "frames")
for name in tests:
    shutil.copy(f"truth/{name}.txt", detections)
"""
LOOP = "import time\nwhile True: time.sleep(0.05)"


def write_evaluated(folder: Path, evaluator: dict, **changes: object) -> Path:
    if not (folder / "log").exists():
        write_database(folder / "runs/mlflow.db")
        (folder / "toy.py").write_text(TOY)
    command = {"command": "{python} toy.py {clouds} {detections}", "format": "kitti", "name": "toy"}
    few = {"surrogate": SMALL["surrogate"] | {"names": ["ig"]}, "lidar": {"azimuth_steps": 90}}
    keys = SMALL | few | {"placement": "line", "evaluator": command | evaluator} | changes
    return write_sweep(folder, "tiny.yaml", **keys)


def jittered(labels: pd.DataFrame) -> pd.DataFrame:
    """Detections, ego frame: labels that are moved, with scores."""
    random = np.random.default_rng(1)
    moved = labels.reset_index(drop=True)
    moved[["x", "y"]] += random.normal(0, 0.15, (len(moved), 2))
    return moved.assign(score=random.uniform(0.1, 1, len(moved)))


def run(*words: str, code: int = 0) -> str:
    return call(app, *words, code=code).output


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_truth(folder: Path) -> None:
    """Jittered boxes of the test frame as KITTI's result files."""
    boxes = pd.read_parquet(folder / "log/boxes.parquet")
    detections = jittered(boxes[boxes["frame"] == 3])
    lines = label_lines(to_labels(detections.assign(occluded=0)))
    scored = zip(lines, detections["score"], strict=True)
    (folder / "truth").mkdir(exist_ok=True)
    (folder / "truth/000003.txt").write_text("".join(f"{a} {b!r}\n" for a, b in scored))


def test_ap_is_that_of_the_same_boxes(here):
    path = write_evaluated(here, {})
    write_truth(here)
    assert "command" in run("run", str(path), "--dry-run")
    assert "command" in run("status", str(path))
    output = run("run", str(path))
    assert "failed" not in output, output
    assert json.loads(run("status", str(path), "--json"))["stages"]["command"] == {"done": 1}
    results = pd.read_parquet("runs/tiny/results.parquet")
    assert set(results["detector"]) == {"toy"}
    sweep, plan = read_plan(path)
    (trial,), store = plan.trials, store_of(sweep)
    evaluation = store.load(trial.evaluate)
    (truths,) = [store.load(task) for task in trial.ground_truths]
    objects = truths.objects[truths.objects["frame"] == 3]
    expected = evaluate_boxes(objects, evaluation.detections, [3], ["Car"])
    both = results.merge(expected, on=["class", "metric", "iou", "difficulty"], how="inner")
    assert len(both) == len(expected)
    assert both["value_x"].equals(both["value_y"])
    # Result files have two decimals.
    boxes = pd.read_parquet("log/boxes.parquet")
    exact = jittered(boxes[boxes["frame"] == 3])[list(GEOMETRY)].to_numpy()
    assert np.allclose(
        np.sort(evaluation.detections[list(GEOMETRY)], 0), np.sort(exact, 0), atol=6e-3
    )
    assert Path("runs/tiny/commands/line-toy-seed-0.log").read_text() == "looked at 1 frames\n"
    assert not list(Path("runs/tiny/commands").glob(".*"))
    assert "toy" in Path("runs/tiny/report.md").read_text()


def keys(path: Path, *overrides: str) -> list[str]:
    _, plan = read_plan(path, overrides)
    return [task.key for task in plan.tasks if task.stage.name == "command"]


def test_what_decides_a_result(here):
    write_evaluated(here, {})
    (here / "net").mkdir()
    (here / "net/weights.pt").write_bytes(b"1")
    path = write_evaluated(here, {"depends_on": ["toy.py", "net"]})
    first = keys(path)
    assert keys(path, "evaluator.time_limit=9", "evaluator.cpus=2", "evaluator.name=other") == first
    assert keys(path, "evaluator.format=parquet") != first
    (here / "net/weights.pt").write_bytes(b"2")
    second = keys(path)
    (here / "toy.py").write_text("")
    third = keys(path)
    path = write_evaluated(here, {"command": "{python} other.py {clouds} {detections}"})
    assert len({*first, *second, *third, *keys(path)}) == 4


def test_seeds_are_of_a_command_that_names_them(here):
    seeded = {"command": "{python} toy.py {clouds} {detections} {seed}"}
    assert len(keys(write_evaluated(here, seeded, grid={"seed": [1, 2]}))) == 2


def stage_of(folder: Path, code: str, **changes: object) -> CommandStage:
    (folder / "own.py").write_text(code)
    command = f"{sys.executable} own.py {{clouds}} {{detections}}"
    settings = {"command": command, "format": "parquet", "folder": folder, "time_limit": 20.0}
    evaluator = EvaluatorCommand.model_validate(settings | changes)
    log = folder / "commands/a.log"
    return CommandStage(evaluator, (), ("Car",), rig=None, seed=None, log=log)


@pytest.fixture
def given():
    """Frames, no labels, and clouds."""
    frames = pd.DataFrame({"scene": "a", "frame": [0, 1], "timestamp_s": [0.0, 0.1], "route": 0})
    frames["split"] = ["train", "test"]
    columns = ["scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY]
    empty = pd.DataFrame(columns=columns).astype(dict.fromkeys(GEOMETRY, float))
    points = [(np.zeros((3, 4), np.float32), [3])] * 2
    crop = (-1.0, -1.0, -1.0, 1.0, 1.0, 1.0)
    return frames, empty.astype({"frame": int}), PointClouds.from_frames([0, 1], points, crop)


WRITE = """
import sys, pandas as pd
row = {"frame": 1, "class": "Car", "x": 5., "y": 0., "z": 1., "length": 4., "width": 2.,
       "height": 1.5, "yaw": 0., "score": 0.5}
table = pd.DataFrame([row, row])
table.loc[1, CHANGE[0]] = CHANGE[1]
table.to_parquet(sys.argv[2] + "/found.parquet")
"""


@pytest.mark.parametrize(
    ("code", "line"),
    [
        ("", r"\{detections\}: no detections; expected files"),
        ("print('a\\nb'); exit(3)", r"exit code 3; last lines: a \| b; log .*a.log"),
        ("print('\\x1b[31mred\\x07\\rb' * 30_000); exit(1)", r"lines: bred \| .*\| b; log"),
        ("import os; os.kill(os.getpid(), 9)", "exit code -9; last lines: none"),
        ("import sys; open(sys.argv[2] + '/a.parquet', 'w').write('no')", "not a Parquet file"),
        (WRITE.replace("CHANGE", "('x', float('nan'))"), "{detections}/found.parquet: row 1"),
        (WRITE.replace("CHANGE", "('score', float('inf'))"), "found.parquet: row 1"),
        (WRITE.replace("CHANGE", "('frame', 0)"), "found.parquet: row 1: unknown frame"),
        (WRITE.replace("CHANGE", "('class', 'Cra')"), "found.parquet: row 1: .*'Cra'"),
        (WRITE.replace("table.to", "table[:0].to").replace("CHANGE", "('x', 1.)"), "no detections"),
        ("import sys; sys.exit('no ' + sys.argv[1] + '/a')", r"last lines: no \{clouds\}/a; log"),
    ],
)
def test_what_is_wrong_is_one_line(code, line, given, tmp_path):
    with pytest.raises(CommandFailed, match=rf"^evaluator.command: .*{line}") as error:
        stage_of(tmp_path, code).detect(*given)
    assert "\n" not in str(error.value)
    assert [path.name for path in (tmp_path / "commands").iterdir()] == ["a.log"]


def test_a_wrong_convention_fails_unless_accepted_and_a_percentage_is_a_caution(given, tmp_path):
    frames, none, clouds = given
    rows = [("a", 1, 0.1, n, "Car", 5 + 5 * n, 3, 0.8, 4, 2, 1.6, 0) for n in range(12)]
    objects = pd.DataFrame(rows, columns=list(none))
    objects.assign(y=-3, score=50)[list(COLUMNS)].to_parquet(tmp_path / "mine.parquet")
    code = "import shutil, sys; shutil.copy('mine.parquet', sys.argv[2])"
    line = r": a: column y: detections fit the labels with y mirrored: median IoU 1.00 instead of "
    line += r"0.00, of 12 objects in 1 frames; .*, or accept the values: evaluator.accept: \[place"
    with pytest.raises(CommandFailed, match=line):
        stage_of(tmp_path, code).detect(frames, objects, clouds)
    result = stage_of(tmp_path, code, accept=["place"]).detect(frames, objects, clouds)
    assert len(result.detections) == 12
    assert [text.partition(";")[0] for text in result.cautions] == [
        "a: column score: scores are from 50 to 50, as percent are"
    ]


def test_no_such_program(given, tmp_path):
    stage = stage_of(tmp_path, "", command="no-such-program {clouds} {detections}")
    with pytest.raises(CommandFailed, match="no-such-program: No such file or directory"):
        stage.detect(*given)


def test_the_time_limit_ends_the_whole_group(given, tmp_path):
    mark = f"left-{os.getpid()}"
    with pytest.raises(CommandFailed, match="killed after the time limit of 1 s"):
        stage_of(tmp_path, hanging(mark), time_limit=1.0).detect(*given)
    assert_gone(mark)


def hanging(mark: str) -> str:
    """A program whose child never ends."""
    return f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {LOOP!r}, {mark!r}])"


def processes(mark: str) -> list[str]:
    numbers = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            numbers.append(path.read_text(errors="replace"))
    return [line for line in numbers if mark in line]


def assert_gone(mark: str) -> None:
    deadline = time.monotonic() + 10
    while processes(mark):
        assert time.monotonic() < deadline, processes(mark)
        time.sleep(0.05)


def test_killed_then_failed_and_tried_again(here):
    mark = f"left-{os.getpid()}-{here.name}"
    path = write_evaluated(here, {})
    write_truth(here)
    (here / "toy.py").write_text(hanging(mark))
    process = Forked(["run", str(path)], here, here / "first.log")
    deadline = time.monotonic() + 120
    while not processes(mark):
        assert time.monotonic() < deadline, (here / "first.log").read_text()
        time.sleep(0.05)
    process.kill()
    process.wait(timeout=60)
    assert_gone(mark)
    assert list((here / "runs/tiny/commands").glob(".*.part"))
    assert "stopped" in run("status", str(path))
    (here / "toy.py").write_text("raise SystemExit('no weights')")
    output = run("run", str(path), code=1)
    assert "exit code 1; last lines: no weights; log " in " ".join(output.split())
    (here / "toy.py").write_text(TOY)
    run("run", str(path))
    assert not list((here / "runs/tiny/commands").glob(".*"))
    results = pd.read_parquet("runs/tiny/results.parquet")
    assert set(results["detector"]) == {"toy"}


def test_the_copy_in_the_run_folder_runs_in_the_same_folder(here):
    (here / "deep").mkdir()
    write_evaluated(here, {})
    path = (here / "tiny.yaml").rename(here / "deep/tiny.yaml")
    sweep, _ = read_plan(path)
    assert sweep.points[0].point.evaluator.folder == here / "deep"
    assert sweep.source["evaluator"]["folder"] == str(here / "deep")


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("env HF_TOKEN=abc {python} toy.py", "HF_TOKEN"),
        ("toy --api-key abc", "--api-key"),
        ("toy ghp_0123456789abcdef", "ghp_…"),
        ("toy --tokenizer abc --max-tokens 9 --token {seed}", None),
    ],
)
def test_a_secret_in_the_command_is_a_caution(here, command, name):
    path = write_evaluated(here, {"command": f"{command} {{clouds}} {{detections}}"})
    cautions = read_plan(path)[1].cautions
    assert [f"evaluator.command: {name} looks" in text for text in cautions] == [True] * bool(name)


def test_doctor_looks_for_the_program(here):
    assert scenes(write_evaluated(here, {})).state == "good"
    result = scenes(write_evaluated(here, {"command": "./none {clouds} {detections}"}))
    assert result.state == "missing"
    assert result.found == f"evaluator.command: no program ./none; found none at {here}/none"


def test_a_command_after_a_generalist(here):
    """The best rigs by a generalist go on; the command alone evaluates them."""
    grid = {"placement": ["line", "center"]}
    rung = {"by": "recall", "keep": 1, "set": {"evaluator": "generalist"}}
    path = write_evaluated(here, {}, grid=grid, promote=[rung])
    _, plan = read_plan(path)
    assert [trial.label for trial in plan.trials][-1] == "center · toy · seed 0 · evaluator=toy"
    assert [task.stage.name for task in plan.tasks].count("command") == 2
