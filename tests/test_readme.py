"""Commands and code of the README work as they are printed."""

import re
from pathlib import Path

import pandas as pd
import pytest

from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import read_plan

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    """The first block in that language."""
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)[0]


def test_the_configuration(tmp_path):
    path = tmp_path / "grid.yaml"
    path.write_text(block("yaml"))
    points = [g.point for g in read_sweep(path).points]
    assert {(p.placement, p.seed) for p in points} == {
        (placement, seed) for placement in ("roof", "corners", "center") for seed in (1, 2, 3)
    }
    assert points[0].vehicle is not None
    assert points[0].lidar.cloud_share == 0.5


def test_its_length():
    assert len(README.split()) <= 900


def test_the_lines_of_python(tmp_path, monkeypatch, capsys):
    boxes = pd.read_csv(ROOT / "tests/data/smig/boxes.csv")
    boxes.to_parquet(tmp_path / "boxes.parquet")
    monkeypatch.chdir(tmp_path)
    exec(block("python"), {})
    assert "s_mig=-" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "trials"), [("grid", 4), ("quirks", 8), ("study", 24), ("generalist", 32)]
)
def test_examples(name, trials):
    _, plan = read_plan(ROOT / f"examples/{name}.yaml")
    assert len(plan.trials) == trials


def test_the_papers_experiment(monkeypatch, tmp_path):
    """Plan with a map in place of CARLA's."""
    for town in ("Town01", "Town03", "Town04", "Town06"):
        maps = tmp_path / "CarlaUE4/Content/Carla/Maps/OpenDrive"
        maps.mkdir(parents=True, exist_ok=True)
        (maps / f"{town}.xodr").write_text("<OpenDRIVE/>")
    monkeypatch.setenv("CARLA_ROOT", str(tmp_path))
    _, plan = read_plan(ROOT / "examples/paper.yaml")
    assert len(plan.trials) == 8 * 3
    scenes = [task for task in plan.tasks if task.stage.name == "scene"]
    assert len(scenes) == 4 * (4 + 1) * 3, "two egos a simulation, in each town, a density"
    train, _ = plan.trials[0].grid_point.point.scene.frame_counts()
    assert train == 4 * 11_200
