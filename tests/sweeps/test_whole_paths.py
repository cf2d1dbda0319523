"""A copy of a configuration in another folder means the same files."""

import yaml

from sweeps.configuration.grid import read_sweep
from sweeps.configuration.whole_paths import portable
from sweeps.search.problem.problem import read_problem
from tests.sweeps.search_files import write_search
from tests.sweeps.small_log import write_sweep

RAYS = "azimuth_deg,elevation_deg\n" + "".join(f"{a},-5\n" for a in range(0, 360, 5))


def copied(source, folder):
    """Its configuration in another folder."""
    path = folder / "elsewhere" / "copy.yaml"
    path.parent.mkdir()
    path.write_text(yaml.safe_dump(dict(source.source)))
    return path


def test_a_sweep_with_patterns_everywhere_can_be_read_from_elsewhere(tmp_path):
    for name in ("one.csv", "two.csv"):
        (tmp_path / name).write_text(RAYS)
    item = {"mounts": [{"z": 2.0, "lidar": {"pattern": "two.csv"}}]}
    grid = {"placement": ["line", "pattern"], "lidar.pattern": ["one.csv", "two.csv"]}
    keys = {"lidar": {"pattern": "one.csv"}, "placements": {"pattern": item}, "grid": grid}
    sweep = read_sweep(write_sweep(tmp_path, **keys))
    again = read_sweep(copied(sweep, tmp_path))
    patterns = {item.point.lidar.pattern for item in again.points}
    assert patterns == {tmp_path / "one.csv", tmp_path / "two.csv"}
    assert [item.point for item in again.points] == [item.point for item in sweep.points]


def test_a_search_among_patterns_can_be_read_from_elsewhere(tmp_path):
    (tmp_path / "one.csv").write_text(RAYS)
    models = {"pattern": "vlp16", "livox": {"pattern": "one.csv", "range": 50.0}}
    problem = read_problem(write_search(tmp_path, search={"models": models}))
    assert read_problem(copied(problem, tmp_path)).models == problem.models
    assert {"pattern", "livox"} <= set(problem.models)


def test_corrections_are_found_from_elsewhere_and_keys_have_their_content(tmp_path):
    (tmp_path / "car.yaml").write_text("distance: 50")
    models = {"correction": "vlp16", "own": {"name": "vlp16", "correction": "car.yaml"}}
    problem = read_problem(write_search(tmp_path, search={"models": models}))
    assert problem.models["own"].correction.distance == 50
    assert read_problem(copied(problem, tmp_path)).models == problem.models
    (tmp_path / "car.yaml").rename(tmp_path / "truck.yaml")
    models["own"]["correction"] = "truck.yaml"
    moved = read_problem(write_search(tmp_path, search={"models": models}))
    assert moved.key == problem.key
    (tmp_path / "truck.yaml").write_text("distance: 60")
    assert read_problem(tmp_path / "small.yaml").key != problem.key
    grid = {"placement": ["line"], "lidar.correction": [None, "truck.yaml"]}
    points = read_sweep(write_sweep(tmp_path, grid=grid)).points
    corrections = [item.rig.lidars[0].correction for item in points]
    assert [item and item.distance for item in corrections] == [None, 60]


def test_other_values_stay_as_they_are(tmp_path):
    (tmp_path / "body.stl").write_text("")
    config = {"vehicle": [[[0, 0, 0], [1, 1, 1]]], "name": "body.stl", 3: {"mesh": None}}
    assert portable(config, tmp_path) == config
