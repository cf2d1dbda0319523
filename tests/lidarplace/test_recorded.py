"""Scenes and clouds that were recorded before."""

from contextlib import suppress

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.clouds import PointClouds, read_clouds, write_clouds
from lidarplace.clouds.recorded import clouds_digest, recorded_clouds
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS
from lidarplace.scenes.recorded import LogScene
from tests.fuzz.mutate_bytes import NO_FILES
from tests.refused import refused

BOXES = pd.DataFrame(
    [("a", 1, 0.0, "7", "Car", 10.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1)], columns=BOX_COLUMNS
)
FRAMES = pd.DataFrame({"scene": "a", "frame": [1, 2, 3], "timestamp_s": 0.0, "route": 0})
FRAMES["split"] = ["train", "train", "test"]


def test_a_log_is_a_scene(tmp_path):
    write_box_log(tmp_path / "town", BoxLog(BOXES, FRAMES))
    scene = LogScene(source="log", folder=tmp_path / "town")
    assert (scene.name, scene.frame_counts()) == ("town", (2, 1))
    same = LogScene(source="log", folder=tmp_path / "town")
    assert same.frame_counts() == (2, 1)
    assert same == scene
    assert len(scene.read().boxes) == 1
    before = scene.digest()
    write_box_log(tmp_path / "town", BoxLog(BOXES, FRAMES.assign(route=1)))
    assert scene.digest() != before


@pytest.mark.parametrize("table", ["boxes", "buildings"])
@pytest.mark.parametrize("what", NO_FILES)
def test_a_log_of_what_is_no_file_has_no_digest(tmp_path, table, what):
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES))
    path = tmp_path / f"{table}.parquet"
    path.unlink()
    NO_FILES[what](path)
    scene = LogScene(source="log", folder=tmp_path)
    for read in (scene.digest, scene.read):
        with refused((str(path), "", "")):
            read()


WIDE = (-100.0, -100.0, -5.0, 100.0, 100.0, 20.0)


def cloud(seed: int) -> tuple[np.ndarray, list[int]]:
    rng = np.random.default_rng(seed)
    points = rng.uniform([-99, -99, -4, 0], [99, 99, 19, 1], (300, 4)).astype(np.float32)
    return points, [100, 200]


def record(folder, *frames):
    write_clouds(folder, PointClouds.from_frames(frames, [cloud(f) for f in frames], WIDE))


def test_recorded_clouds_are_found_by_frame_and_cut(tmp_path):
    record(tmp_path / "route-0", 5, 7)
    record(tmp_path / "route-1", 9)
    crop = (0.0, -50.0, -5.0, 60.0, 50.0, 20.0)
    found = recorded_clouds(tmp_path, np.array([9, 5]), crop)
    assert found.frames.tolist() == [9, 5]
    for i, frame in enumerate((9, 5)):
        points, counts = cloud(frame)
        lidar = np.repeat([0, 1], counts)
        inside = (points[:, 0] >= 0) & (points[:, 0] <= 60) & (np.abs(points[:, 1]) <= 50)
        np.testing.assert_allclose(found[i][:, :3], points[inside, :3], atol=0.004)
        np.testing.assert_array_equal(found.lidar(i), lidar[inside])


@pytest.mark.parametrize("name", ["data", "offsets", "counts", "frames", "crop", "step"])
def test_every_byte_of_recorded_clouds_counts(tmp_path, name):
    record(tmp_path / "route", 1, 2)
    before = clouds_digest(tmp_path)
    array = getattr(read_clouds(tmp_path / "route"), name).copy()  # the file is written over
    for place in range(0, array.size, 1 + array.size // 20):
        changed = array.copy()
        changed.flat[place] += 1
        np.save(tmp_path / "route" / f"{name}.npy", changed)
        with suppress(ValueError):  # refused: offsets that do not fit the data
            assert clouds_digest(tmp_path) != before, place
