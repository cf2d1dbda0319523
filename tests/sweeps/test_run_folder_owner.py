"""A run folder belongs to one configuration file and its scene."""

import pytest
import yaml
from small_log import write_sweep

from lidarplace.base.errors import InputError
from sweeps.command_line import app
from sweeps.store.run_folder_owner import claim_run_folder
from tests.mlflow_database import write_database
from tests.sweeps.toy import call

SCENE = {"seed": 1, "density": 80, "routes": 4}


@pytest.mark.parametrize(
    ("change", "allowed"),
    [
        ({}, True),
        ({"routes": 16, "test_routes": 8}, True),
        ({"density": 40}, False),
        ({"source": "log", "folder": "logs/a"}, False),
    ],
)
def test_a_folder_keeps_its_scene(tmp_path, change, allowed):
    config, folder = tmp_path / "a.yaml", tmp_path / "runs/a"
    config.touch()
    claim_run_folder(folder, config, {"scene": SCENE})
    if allowed:
        claim_run_folder(folder, config, {"scene": SCENE | change, "grid": {"seed": [1, 2]}})
        return
    with pytest.raises(InputError) as error:
        claim_run_folder(folder, config, {"scene": SCENE | change})
    assert error.value.place == str(folder)
    assert "another scene" in error.value.problem
    assert "--set name=a_2" in error.value.fix


def test_a_folder_moves_with_its_file_and_outlives_it(tmp_path):
    (tmp_path / "old").mkdir()
    config = tmp_path / "old/a.yaml"
    config.touch()
    claim_run_folder(tmp_path / "old/runs/a", config, {"scene": SCENE})
    (tmp_path / "old").rename(tmp_path / "new")
    claim_run_folder(tmp_path / "new/runs/a", tmp_path / "new/a.yaml", {"scene": SCENE})
    other = tmp_path / "new/b.yaml"
    (tmp_path / "new/a.yaml").rename(other)
    claim_run_folder(tmp_path / "new/runs/a", other, {"scene": SCENE})


def test_another_file_of_the_same_name_leaves_the_pages(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    keys = {"detector": None, "placement": "line", "name": "sweep"}
    write_database(tmp_path / "runs/mlflow.db")
    first, second = (write_sweep(tmp_path, f"{name}.yaml", **keys) for name in "ab")
    call(app, "run", str(first), code=0)
    pages = {path: path.read_bytes() for path in (tmp_path / "runs/sweep").glob("*.html")}
    shown = call(app, "run", str(second), code=2).output
    assert f"{tmp_path}/runs/sweep: belongs to another configuration; expected a.yaml, " in shown
    assert all(path.read_bytes() == content for path, content in pages.items())
    call(app, "run", str(second), "--set", "name=sweep_2", code=0)
    scene = yaml.safe_load(second.read_text())["scene"] | {"seed": 1}
    call(app, "run", str(first), "--set", f"scene={scene}", code=2)
