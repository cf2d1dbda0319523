"""One file goes all the way: the answer of `cheapest` is read by every command as it is."""

import json
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from lidarplace import Lidar, Mount
from lidarplace.configuration.placement import read_placement
from lidarplace.studio.rigs_file import read_rigs
from sweeps.command_line import app
from sweeps.commands.init import VEHICLES
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar

SEARCH = yaml.safe_load("""
scene: {seed: 1, routes: 2, test_routes: 1, frames_per_route: 8, frame_stride: 10}
roi: {x: [-15, 15], y: [-15, 15], z: [0, 4]}
surrogate: {resolution: 0.7}
classes: [Pedestrian]
search:
  vehicle: [[[-2.5, -1, 0], [2.5, 1, 2.6]]]
  models: {small: {name: vlp16, price: 4}, dome: {name: bpearl, price: 3}}
  keep_out: {hatch: {x: [-0.4, 0.4], y: [-0.4, 0.4], z: [2.6, 2.9]}}
  lidars: [1, 2]
  zones: {front: {x: 2.6, y: [-0.9, 0.9], z: 0.8, models: [dome]}}
  objective: [margin, price]
  requirements:
    - {name: ahead, where: {x: [3.5, 5], y: [-1, 1]}, what: Pedestrian, at_least: {points: 20}}
  greedy: {position_step: 0.9, angle_step_deg: 20}
  cheapest: {by: price, seconds: 20}
""")


def run(*words):
    result = CliRunner().invoke(app, [*words])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chain")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("my.yaml").write_text(yaml.safe_dump(SEARCH))
        run("cheapest", "my.yaml")
        yield folder / "runs/my/cheapest/placement.yaml"


def test_the_answer_has_the_noise_and_the_losses_of_the_search(tmp_path):
    models = {"small": {"name": "vlp16", "price": 4}, "dome": {"name": "bpearl", "drop_off": 0}}
    content = SEARCH | {"lidar": {"range_noise": 0.02, "drop_off": 0.05}}
    content["search"] = SEARCH["search"] | {"models": models, "objective": "margin"}
    path = tmp_path / "my.yaml"
    path.write_text(yaml.safe_dump(content))
    problem = read_problem(path)
    mounts = {"small": Mount(x=2.6, z=0.8), "dome": Mount(x=2.6, y=0.5, z=0.8)}
    rig = tuple(MountedLidar(name, "front", mount) for name, mount in mounts.items())
    wanted = tuple(problem.models[name] for name in mounts)
    assert [lidar.drop_off for lidar in wanted] == [0.05, 0]
    answer = tmp_path / "answer.yaml"
    for text in (problem.placement_text(rig), problem.rigs_text({"one": rig})):
        answer.write_text(text)
        file = read_rigs(answer)
        assert file.rigs[0].models(file.lidar) == wanted
    answer.write_text(problem.placement_text(rig))
    assert read_placement(answer, Lidar.paper()).lidars == wanted


def test_every_command_reads_the_answer(answer):
    (outcome,) = json.loads(run("requirements", str(answer), "--json"))["outcomes"]
    assert (outcome["rig"], outcome["met"]) == ("placement", True)
    file = read_rigs(answer)
    assert [rig.name for rig in file.rigs] == ["placement"]
    assert file.settings.prices == {"vlp16": 4, "bpearl": 3}
    assert [zone.name for zone in file.zones] == ["front"]
    assert file.vehicle.boxes.tolist() == SEARCH["search"]["vehicle"]
    plan = run("run", str(answer), "--dry-run")
    assert "ahead" in plan
    run("rig", str(answer), "objects.json", "--format", "carla")
    rigs = answer.with_name("rigs.yaml")
    refused = CliRunner().invoke(app, ["rig", str(rigs), "objects.json", "--format", "carla"])
    assert refused.output.strip().endswith(f"; use {answer}")
    again = read_problem(answer)
    (placed, *_) = again.start["placement"]
    assert placed.lidar.model == "dome"
    assert "price 3" in run("cheapest", str(answer))


def test_requirements_read_the_file_of_the_studio(answer):
    rigs = answer.with_name("rigs.yaml")
    (outcome,) = json.loads(run("requirements", str(rigs), "--json"))["outcomes"]
    assert (outcome["rig"], outcome["met"]) == ("the rig", True)
    refusal = CliRunner().invoke(app, ["run", str(rigs)])
    assert "prices: key of a file of the studio; run: lidarplace studio" in refusal.stderr


def test_a_start_of_another_model_is_refused(answer):
    content = yaml.safe_load(answer.read_text())
    content["mounts"][0]["lidar"] = "mid70"
    answer.with_name("other.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(ValueError, match=r"start: other: LiDAR 1 is none of search.models; exp"):
        read_problem(answer.with_name("other.yaml"))


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_starts_for_vehicles(vehicle, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert f"my_{vehicle}.yaml" in run("init", ".", "--vehicle", vehicle)
    assert "least price" in run("cheapest", f"my_{vehicle}.yaml", "--dry-run")
    run("search", f"my_{vehicle}.yaml", "--dry-run")


def test_roi_that_does_not_divide(tmp_path):
    """Nothing is asked where only margin and price count; else the nearest one is offered."""
    path = tmp_path / "my.yaml"
    path.write_text(yaml.safe_dump(SEARCH))
    assert read_problem(path).file.roi.x == (-15.05, 15.05)
    with pytest.raises(ValueError, match=r"the nearest is \[-15.05, 15.05\].*set roi.fit: nearest"):
        read_problem(path, ["search.objective=expected_ig"])
    changes = ["search.objective=expected_ig", "roi.fit=nearest"]
    assert read_problem(path, changes).file.roi.x == (-15.05, 15.05)
