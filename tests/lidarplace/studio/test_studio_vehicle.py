"""The body of the studio's file is what hides: in clouds, in numbers, in answers and in sweeps."""

import numpy as np
import pytest
import yaml

from lidarplace.clouds.collect import collect
from sweeps.plan.plan import read_plan
from tests.lidarplace.studio import rigs
from tests.lidarplace.studio.rigs import ROI

SCREEN = [[1.5, -4.0, 0.0], [1.6, 4.0, 4.0]]
"""It hides the car ahead from a LiDAR in the middle, and not the one behind."""
RIGS = {
    "lidar": {"beams": 16, "elevation_deg": [-25, 5], "azimuth_steps": 720},
    "placements": {"one": {"mounts": [{"z": 1.8}]}},
}


def studio_of(folder, **keys):
    return rigs.studio_of(folder, RIGS | keys, (8.0, 1.0), (-9.0, -2.0))


def as_box(folder):
    return {"vehicle": [SCREEN]}


def as_keep_out(folder):
    x, y, z = zip(*SCREEN, strict=True)
    return {"vehicle": [], "keep_out": {"screen": {"x": [*x], "y": [*y], "z": [*z]}}}


def as_mesh(folder):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box(bounds=SCREEN).export(folder / "screen.stl")
    return {"vehicle": "screen.stl"}


@pytest.fixture(params=[as_box, as_keep_out, as_mesh])
def screened(request, tmp_path):
    return studio_of(tmp_path, **request.param(tmp_path))


def test_what_the_vehicle_hides_is_not_seen(screened, tmp_path):
    free = studio_of(tmp_path, vehicle=[])
    unhidden = free.view.objects(free.placement).set_index("object_id")
    assert unhidden["points"].min() > 0
    seen = screened.view.objects(screened.placement).set_index("object_id")
    assert seen["points"].to_dict() == {"car 0": 0, "car 1": unhidden["points"]["car 1"]}
    recall = screened.numbers().expected_recall["Car"]
    assert recall == pytest.approx(seen["probability"]["car 1"] / 2)
    x, y, _ = screened.view.cloud(screened.placement, 10**6).points.T
    assert (x < -5).any()
    assert not ((x > 1.6) & (np.abs(y) < 2.5 * x)).any()
    (rays,) = screened.why_unseen("car 0")
    assert rays.stopped == {"the rig itself or what carries it": rays.aimed}
    assert rays.aimed == unhidden["points"]["car 0"]


def test_a_sweep_of_the_rigs_has_the_same_clouds(screened, scene, tmp_path):
    screened.sweep(tmp_path / "sweep.yaml", scene)
    sweep, _ = read_plan(tmp_path / "sweep.yaml")
    body = sweep.points[0].vehicle
    view, rig = screened.view, screened.placement
    crop = (ROI.x[0], ROI.y[0], ROI.z[0] - 0.5, ROI.x[1], ROI.y[1], ROI.z[1])
    swept = collect(screened.log, [0], rig, crop, vehicle=body)[0]
    assert swept[:, :3] == pytest.approx(view.cloud(rig, 10**6).points, abs=1e-3)


def test_the_vehicle_is_in_the_picture(screened):
    (drawn,) = [trace for trace in screened.plot().data if trace.name == "vehicle"]
    corners = np.array([drawn.x, drawn.y, drawn.z])
    assert corners.min(axis=1) == pytest.approx(SCREEN[0])
    assert corners.max(axis=1) == pytest.approx(SCREEN[1])


def test_a_sweep_has_a_vehicle_with_its_keep_outs_if_the_file_has_any(tmp_path):
    plain, racked = tmp_path / "plain.yaml", tmp_path / "racked.yaml"
    studio = studio_of(tmp_path)
    assert studio.file.carrier is None
    studio.sweep(plain, {"source": "log", "folder": "mine"})
    assert "vehicle" not in yaml.safe_load(plain.read_text())
    studio = studio_of(tmp_path, keep_out={"rack": {"x": [0, 1], "y": [0, 1], "z": [1.5, 1.6]}})
    studio.sweep(racked, {"source": "log", "folder": "mine"})
    swept = yaml.safe_load(racked.read_text())["vehicle"]
    assert swept["boxes"] == studio.file.vehicle.boxes.tolist()
    assert swept["keep_out"] == [[[0, 0, 1.5], [1, 1, 1.6]]]
