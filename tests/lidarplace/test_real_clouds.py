"""Real clouds beside a log: counted by box and LiDAR, kept in the ego frame, refused if wrong."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.clouds.clouds import read_clouds
from lidarplace.clouds.recorded import recorded_clouds
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.real_clouds import count_real_points
from tests.refused import refused

RIG = RecordedRig(
    ("top", "left"), Placement("car", [Mount(z=2.0), Mount(y=0.8, z=1.5)], Lidar.named("vlp16"))
)
EGO = (0.0, 0.0, 0.0)


def log_of(boxes=12, rig=RIG, seed=0):
    """Cars around the vehicle in frame 3; frame 4 is empty."""
    rng = np.random.default_rng(seed)
    around = np.linspace(0, 2 * np.pi, boxes, endpoint=False)
    table = pd.DataFrame({"x": 20 * np.cos(around), "y": 20 * np.sin(around), "z": 0.8})
    table = table.assign(length=4.4, width=1.8, height=1.6, yaw=rng.uniform(-3, 3, boxes))
    table["object_id"] = [str(number) for number in range(boxes)]
    table = table.assign(frame=3, scene="a", timestamp_s=0.0, **{"class": "Car"})
    frames = pd.DataFrame({"frame": [3, 4], "scene": "a", "timestamp_s": 0.0, "route": 0})
    return BoxLog(table, frames.assign(split="test"), rigs={} if rig is None else {"a": rig})


def on_sides(log, points=40, seed=0):
    """A cloud of points just inside the boxes, by turns of both LiDARs."""
    rng = np.random.default_rng(seed)
    found = []
    for x, y, z, length, width, height, yaw in log.boxes[list(GEOMETRY)].to_numpy():
        own = rng.uniform(-0.49, 0.49, (points, 3)) * [length, width, height]
        own[:, 0] = np.copysign(0.49 * length, own[:, 0])
        turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        found.append(own @ turn + [x, y, z])
    cloud = pd.DataFrame(np.concatenate(found), columns=list("xyz"))
    return cloud.assign(lidar=np.arange(len(cloud)) % 2, ring=0, intensity=0.5)


def write(folder, cloud, name="3.parquet"):
    (folder / "a").mkdir(parents=True, exist_ok=True)
    cloud.to_parquet(folder / "a" / name)
    return folder, EGO


def test_points_are_counted_by_lidar_and_kept(tmp_path):
    log = log_of()
    cloud = pd.concat([on_sides(log), pd.DataFrame({"x": [np.nan, 500.0], "y": 0.0, "z": 1.0})])
    clouds = write(tmp_path / "in", cloud.assign(lidar=cloud["lidar"].fillna(1)))
    counted, number = count_real_points(log, *clouds, tmp_path / "kept")
    assert number == 1
    by_lidar = counted.boxes[["points", "points/top", "points/left"]]
    assert by_lidar.to_numpy().tolist() == [[40, 20, 20]] * 12
    kept = read_clouds(tmp_path / "kept" / "0000")
    assert kept.frames.tolist() == [3]
    assert kept.counts.tolist() == [[240, 240]], "what is 500 m away is not kept"
    expected = cloud[cloud["lidar"] == 1][list("xyz")].to_numpy()
    np.testing.assert_allclose(kept[0][240:, :3], expected, atol=0.003)
    assert [path.name for path in tmp_path.iterdir()] in (["in", "kept"], ["kept", "in"])


def test_a_long_scene_is_kept_in_parts(tmp_path, monkeypatch):
    monkeypatch.setattr("lidarplace.scenes.real_clouds.PART", 1)
    log = log_of()
    clouds = write(tmp_path / "in", on_sides(log))
    write(tmp_path / "in", on_sides(log).iloc[:3], "0004.parquet")
    (tmp_path / "in" / ".trash").mkdir()
    (tmp_path / "in" / ".trash" / "4.parquet").touch()  # hidden folders are not searched
    _, number = count_real_points(log, *clouds, tmp_path / "kept")
    assert number == 2
    kept = recorded_clouds(tmp_path / "kept", np.array([4, 3]), (-50, -50, -5, 50, 50, 5))
    assert kept.counts.tolist() == [[2, 1], [240, 240]]


def test_counts_of_the_source_stay_and_lidars_may_have_names(tmp_path):
    log = log_of()
    log.boxes["points"] = 7.0
    cloud = on_sides(log).assign(lidar=["left"] * 480)
    counted, _ = count_real_points(log, *write(tmp_path, cloud))
    by_lidar = counted.boxes[["points", "points/top", "points/left"]]
    assert by_lidar.to_numpy().tolist() == [[7, 0, 40]] * 12


def test_without_a_rig_or_lidars_only_all_points_are_counted(tmp_path):
    for rig, cloud in ((None, on_sides(log_of())), (RIG, on_sides(log_of()).drop(columns="lidar"))):
        counted, _ = count_real_points(log_of(rig=rig), *write(tmp_path, cloud), tmp_path / "kept")
        assert set(counted.boxes["points"]) == {40}
        assert "points/top" not in counted.boxes
        assert read_clouds(tmp_path / "kept" / "0000").counts.tolist() == [[480]]


TURNS = st.tuples(st.floats(0.5, 3), st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3))


@settings(max_examples=20)
@given(placed=TURNS)
def test_a_cloud_in_the_frame_of_its_lidar_is_placed_by_the_rig(tmp_path_factory, placed):
    mount = Mount(0.3, -0.2, *placed)  # z, roll, pitch, yaw
    rig = RecordedRig(("top",), Placement("one", [mount], Lidar.named("vlp16")))
    log = log_of(rig=rig)
    cloud = on_sides(log).drop(columns="lidar")
    cloud[list("xyz")] = (cloud[list("xyz")].to_numpy() - mount.position) @ mount.rotation
    folder = tmp_path_factory.mktemp("c")
    write(folder, cloud)
    counted, _ = count_real_points(log, folder)
    assert set(counted.boxes["points/top"]) == {40}


@pytest.mark.parametrize("shift", [(0, 0, 1.5), (0, 0, -1.7), (6.0, 0, 0), (0, 1.2, 0)])
def test_clouds_in_another_frame_are_refused_and_leave_nothing(tmp_path, shift):
    clouds = write(tmp_path / "in", on_sides(log_of()).add([*shift, 0, 0, 0]))
    with refused((str(tmp_path / "in"), "", "%")):
        count_real_points(log_of(), *clouds, tmp_path / "kept")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]
