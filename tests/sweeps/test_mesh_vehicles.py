"""A vehicle as a mesh file: read, refused in a line, and in all that a sweep or a search does."""

import pickle
import shutil
import sys

import numpy as np
import pytest

from lidarplace import Mount
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import make_plan
from sweeps.search.problem.constraints import measures_of
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar
from tests.sweeps.search_files import write_search
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import ran
from tracking.run_folders.sweep import RunFolder

trimesh = pytest.importorskip("trimesh")

LOW, HIGH = (-2.0, -0.9, 0.2), (2.0, 0.9, 1.5)
PEOPLE = {"name": "people", "where": {"distance": [0.5, 2]}, "what": "Pedestrian", "step": 0.5}


def solid():
    return trimesh.creation.box(bounds=[LOW, HIGH])


@pytest.fixture
def folder(tmp_path):
    solid().export(tmp_path / "body.stl")
    return tmp_path


def sweep_file(folder, name="grid.yaml", **changes):
    base = {"placement": "line", "vehicle": {"mesh": "body.stl"}}
    return write_sweep(folder, name, **base | changes)


def body_of(folder, vehicle):
    return read_sweep(sweep_file(folder, vehicle=vehicle)).points[0].vehicle


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb", "off"])
def test_formats(folder, suffix):
    solid().export(folder / f"other.{suffix}")
    body = body_of(folder, f"other.{suffix}")
    np.testing.assert_allclose(body.extents, [[LOW, HIGH]], atol=1e-6)
    assert len(body.mesh.faces) == 12
    file = solid()
    file.update_faces(np.arange(12) > 1)
    assert not file.is_watertight
    file.export(folder / f"open.{suffix}")
    assert len(body_of(folder, f"open.{suffix}").mesh.faces) == 10


def test_units_axes_and_origin(folder):
    file = solid()
    file.apply_translation([0, 0, -0.2])
    # Millimetres, x to the back, y up: turned back by 90 degrees of roll and 180 of yaw.
    file.apply_transform(trimesh.transformations.rotation_matrix(-np.pi, [0, 0, 1]))
    file.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    file.apply_scale(1000)
    file.export(folder / "cad.obj")
    settings = {"mesh": "cad.obj", "scale": 0.001, "roll_deg": 90, "yaw_deg": 180}
    settings["origin"] = [0, 0, 0.2]
    np.testing.assert_allclose(body_of(folder, settings).extents, [[LOW, HIGH]], atol=1e-6)


def broken(folder):
    """Files that are wrong, the vehicle that names each, and the end of the line."""
    solid().apply_scale(1000).export(folder / "mm.stl")
    solid().apply_scale(0.001).export(folder / "tiny.stl")
    solid().apply_translation([0, 0, -0.85]).export(folder / "low.stl")
    solid().apply_translation([60, 0, 0]).export(folder / "away.stl")
    (folder / "empty.stl").write_bytes(b"")
    (folder / "text.obj").write_text("hello\n")
    (folder / "cut.stl").write_bytes((folder / "body.stl").read_bytes()[:300])
    (folder / "body.xyz").write_text("1 2 3\n")
    (folder / "line.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    (folder / "nan.obj").write_text("v 0 0 0\nv 1 0 nan\nv 0 2 0\nf 1 2 3\n")
    return [
        ("none.stl", "none.stl: No such file or directory"),
        ("log", "log: Is a directory"),
        ("mm.stl", "side of 0.5 to 40 m, found 4e+03 by 1.8e+03 by 1.3e+03 m; scale is"),
        ("tiny.stl", "side of 0.5 to 40 m, found 0.004 by 0.0018 by 0.0013 m"),
        ("low.stl", "at most 0.5 m under the ground, found 0.65 m"),
        ("away.stl", "from the middle of the vehicle, found 62 m; origin is where"),
        ("empty.stl", "empty.stl: "),
        ("text.obj", "text.obj: "),
        ("cut.stl", "cut.stl: "),
        ("body.xyz", "body.xyz: "),
        ("line.obj", "expected triangles that have an area, found none"),
        ("nan.obj", "nan.obj: "),
    ]


def test_wrong_files_are_one_line(folder):
    for vehicle, message in broken(folder):
        path = sweep_file(folder, vehicle=vehicle)
        with pytest.raises(ConfigError) as refused:
            read_sweep(path)
        line = str(refused.value)
        assert "\n" not in line
        assert line.startswith(f"{path}: vehicle"), line
        assert message in line, line


def test_too_many_triangles_and_no_trimesh(folder, monkeypatch):
    monkeypatch.setattr("lidarplace.mounting.mesh_file.MOST_TRIANGLES", 11)
    expected = r"body\.stl: expected at most 11 triangles, found 12; simplify the mesh"
    with pytest.raises(ConfigError, match=expected):
        read_sweep(sweep_file(folder))
    monkeypatch.setitem(sys.modules, "trimesh", None)
    shutil.copy(folder / "body.stl", folder / "another.stl")
    with pytest.raises(ConfigError, match=r"pip install 'lidarplace\[mesh\]'"):
        body_of(folder, "another.stl")


def test_the_path_is_beside_the_file_and_content_decides_the_keys(folder, monkeypatch, tmp_path):
    def collected(path):
        plan = make_plan(read_sweep(path))
        return {task.stage.name: task.key for task in plan.tasks}

    params = collected(sweep_file(folder))
    monkeypatch.chdir("/")
    assert collected(folder / "grid.yaml") == params
    other = folder / "moved"
    other.mkdir()
    shutil.move(folder / "body.stl", other / "renamed.stl")
    moved = collected(sweep_file(folder, "moved/grid.yaml", vehicle="renamed.stl"))
    assert moved == params
    taller = solid()
    taller.apply_scale([1, 1, 1.01])
    taller.export(other / "renamed.stl")
    changed = collected(other / "grid.yaml")
    assert {stage for stage in params if changed[stage] != params[stage]} == {
        *("collect", "recall", "finetune", "evaluate")
    }


def test_a_task_has_the_triangles_with_it(folder):
    plan = make_plan(read_sweep(sweep_file(folder)))
    (task,) = [task for task in plan.tasks if task.stage.name == "recall"]
    key = task.key
    (folder / "body.stl").unlink()
    stage = pickle.loads(pickle.dumps(task.stage))
    np.testing.assert_array_equal(stage.vehicle.mesh.triangles, task.stage.vehicle.mesh.triangles)
    assert type(task)(stage, "", task.inputs).key == key


def test_mounts_inside_are_refused(folder):
    inside = {"mine": {"mounts": [{"z": 2.0}, {"x": 1.9, "z": 0.6}]}}
    with pytest.raises(ConfigError, match=r"LiDAR 2 at \(1.9, 0, 0.6\) is inside the vehicle's"):
        read_sweep(sweep_file(folder, placements=inside, placement="mine"))
    outside = {"mine": {"mounts": [{"z": 1.501}, {"x": 2.001, "z": 0.6}]}}
    read_sweep(sweep_file(folder, placements=outside, placement="mine"))


def test_searches_with_a_mesh_measure_as_with_the_box(folder):
    zones = {"front": {"x": [1.5, 2.6], "y": [-0.5, 0.5], "z": 0.7}}
    ground = {"name": "ground", "where": {"distance": [0.2, 2], "z": [0, 1]}, "step": 0.5}
    needs = [PEOPLE | {"at_least": {"points": 3}}, ground | {"at_least": {"coverage": 0.1}}]
    search = {"lidars": 1, "zones": zones, "constraints": {"body_share": 0.6}}
    search |= {"requirements": needs, "greedy": None}
    rig = (MountedLidar("lidar", "front", Mount(2.31, 0.1, 0.7)),)
    measures = []
    for vehicle in ({"mesh": "body.stl"}, [[LOW, HIGH]]):
        problem = read_problem(write_search(folder, search=search | {"vehicle": vehicle}))
        criteria = problem.criteria
        names = {constraint.name for constraint in criteria.constraints}
        assert {"body", "body_share", "requirement.ground", "requirement.people"} <= names
        measures.append(measures_of(rig, criteria.constraints, criteria.carrier))
    assert measures[0] == pytest.approx(measures[1], abs=1e-9)


def test_the_run_folder_of_a_sweep_has_the_mesh(folder):
    sweep = read_sweep(sweep_file(folder, detector=None))
    (folder / "body.stl").unlink()  # it has been read
    body = RunFolder.read(ran(sweep, folder)[-1]).sweep.body
    assert len(body.mesh.faces) == 12
    np.testing.assert_allclose(body.extents, [[LOW, HIGH]])
