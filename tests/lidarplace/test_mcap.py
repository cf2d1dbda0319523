"""A recording for Foxglove, read by MCAP's own library and decoded by the schemas in the file."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from lidarplace.clouds.clouds import write_clouds
from lidarplace.clouds.collect import collect
from lidarplace.clouds.recorded import rig_record
from lidarplace.commands.export import app
from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.placement import PAPER_PLACEMENTS
from lidarplace.viewing.mcap import clock
from tests.sweeps.small_log import write_small_log
from tests.sweeps.toy import call

pytest.importorskip("foxglove")
KEPT = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)


@pytest.fixture
def log(tmp_path) -> BoxLog:
    """A small log whose vehicle moves."""
    write_small_log(tmp_path / "log")
    still = read_box_log(tmp_path / "log")
    poses = {"ego_x": np.arange(len(still.frames)) * 2.0, "ego_y": 1.0, "ego_yaw": 0.5}
    write_box_log(tmp_path / "log", BoxLog(still.boxes, still.frames.assign(**poses)))
    return read_box_log(tmp_path / "log")


def messages(path):
    """(topic, schema, time in ns, message) of a file, in the order of time."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.message_factory import GetMessages
    from mcap.reader import make_reader

    decoded, classes = [], {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                content = json.loads(message.data)
            else:
                if schema.id not in classes:
                    files = FileDescriptorSet.FromString(schema.data)
                    classes[schema.id] = GetMessages(files.file)[schema.name]
                content = classes[schema.id].FromString(message.data)
            decoded.append((channel.topic, schema.name, message.log_time, content))
    return decoded


def run(*arguments):
    result = call(app, *arguments)
    return result.stdout


def by_topic(decoded, topic):
    return [content for name, _, _, content in decoded if name == topic]


def test_a_simulated_log(tmp_path, log):
    out, rig = tmp_path / "line.mcap", PAPER_PLACEMENTS["line_roll"]
    output = run(tmp_path / "log", out, "--placement", "line_roll", "--seed", 3)
    decoded = messages(out)
    schemas = dict.fromkeys([f"/lidar_{i + 1}" for i in range(4)], "foxglove.PointCloud")
    schemas |= {"/objects": "foxglove.SceneUpdate", "/tf": "foxglove.FrameTransforms"}
    assert {topic: schema for topic, schema, _, _ in decoded if topic != "/frame"} == schemas
    numbers = log.frames["frame"].to_numpy()
    clouds = collect(log, numbers, rig, KEPT, 3)
    inside = log.boxes.query("0 <= x <= 40 and -20 <= y <= 20 and 0 <= z <= 4")
    assert f"{len(numbers)} frames, {len(inside)} boxes, {clouds.counts.sum():,} points" in output
    assert [one["frame"] for one in by_topic(decoded, "/frame")] == numbers.tolist()
    assert np.array_equal([t for topic, _, t, _ in decoded if topic == "/tf"], clock(log.frames))
    for index, number in enumerate(numbers):
        for lidar in range(4):
            cloud = by_topic(decoded, f"/lidar_{lidar + 1}")[index]
            assert (cloud.frame_id, cloud.point_stride) == ("ego", 16)
            fields = [(f.name, f.offset) for f in cloud.fields]
            assert fields == [("x", 0), ("y", 4), ("z", 8), ("intensity", 12)]
            points = np.frombuffer(cloud.data, "<f4").reshape(-1, 4)
            owner = clouds.lidar(index)
            np.testing.assert_array_equal(points, clouds[index][owner == lidar])
        update = by_topic(decoded, "/objects")[index]
        rows = inside[inside["frame"] == number]
        assert [entity.id for entity in update.entities] == rows["object_id"].tolist()
        assert [entity.metadata[0].value for entity in update.entities] == rows["class"].tolist()
        boxes = [_geometry(entity.cubes[0]) for entity in update.entities]
        expected = rows[list(GEOMETRY)].to_numpy(float)
        np.testing.assert_allclose(np.reshape(boxes, (-1, 7)), expected, atol=1e-9)
        *mounts, vehicle = by_topic(decoded, "/tf")[index].transforms
        for transform, mount in zip(mounts, rig.mounts, strict=True):
            at, turned = transform.translation, transform.rotation
            np.testing.assert_allclose([at.x, at.y, at.z], mount.position)
            matrix = Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]).as_matrix()
            np.testing.assert_allclose(matrix, mount.rotation, atol=1e-12)
        assert (vehicle.parent_frame_id, vehicle.child_frame_id) == ("world", "ego")
        assert (vehicle.translation.x, vehicle.translation.y) == (2.0 * index, 1.0)


def _geometry(cube):
    at, size, turned = cube.pose.position, cube.size, cube.pose.orientation
    yaw = Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]).as_euler("ZYX")[0]
    return [at.x, at.y, at.z, size.x, size.y, size.z, yaw]


def test_recorded_clouds_are_taken_as_they_are(tmp_path, log):
    rig = PAPER_PLACEMENTS["line"]
    folder = tmp_path / "log/clouds/line"
    numbers = log.frames["frame"].to_numpy()
    clouds = collect(log, numbers, rig, KEPT, 7)
    write_clouds(folder / "route", clouds)
    (folder / "placement.json").write_text(json.dumps(rig_record(rig)))
    output = run(tmp_path / "log", tmp_path / "a.mcap", "--placement", "line", "--recorded")
    assert f"{clouds.counts.sum():,} points" in output
    assert f"{collect(log, numbers, rig, KEPT, 0).counts.sum():,} points" not in output
    (first, *_) = by_topic(messages(tmp_path / "a.mcap"), "/lidar_1")
    points = np.frombuffer(first.data, "<f4").reshape(-1, 4)
    np.testing.assert_array_equal(points, clouds[0][clouds.lidar(0) == 0])


def test_drives_follow_each_other():
    rows = [("a", 0, 5.0), ("b", 1, np.nan), ("a", 0, 5.5), ("b", 1, np.nan), ("b", 2, 9.0)]
    frames = pd.DataFrame(rows, [9, 8, 7, 6, 5], ["scene", "route", "timestamp_s"])
    assert (clock(frames) / 1e9).tolist() == [0.0, 1.5, 0.5, 1.6, 2.6]
