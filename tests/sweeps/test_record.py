"""The scenes of a sweep as box logs, and sweeps over logs that were recorded before."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.clouds import write_clouds
from lidarplace.clouds.collect import collect
from lidarplace.clouds.recorded import clouds_digest
from lidarplace.logs.box_log import read_box_log
from lidarplace.mounting.errors import MountingErrors
from lidarplace.scenes.recorded import LogRecording, LogScene
from sweeps.commands.record import app
from sweeps.stages.collect import CollectStage, RecordedCloudsStage
from sweeps.stages.scene import SceneStage
from tests.refused import refused
from tests.sweeps.small_log import TOWN
from tests.sweeps.toy import call

CROP = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("record")


@pytest.fixture(scope="module")
def recorded(folder):
    config = folder / "grid.yaml"
    settings = {"placement": "line", "scene": TOWN | {"egos_per_run": 1}, "ray": "debug"}
    settings |= {"output": str(folder / "runs"), "grid": {"scene.density": [20, 30]}}
    config.write_text(yaml.safe_dump(settings))
    return call(app, config, folder / "logs")


def test_every_scene_of_the_grid_is_a_box_log(folder, recorded):
    written = sorted(path.name for path in (folder / "logs").iterdir())
    assert written == ["scene.density=20", "scene.density=30"]
    assert recorded.stdout.count("objects per frame") == 2
    for density in (20, 30):
        log = read_box_log(folder / "logs" / f"scene.density={density}")
        assert log.frames["frame"].tolist() == list(range(12))
        assert log.frames["scene"].nunique() == 3, "every simulation is a scene of its own"
        assert set(log.frames["split"]) == {"train", "test"}
        assert len(log.buildings) > 0


def test_a_mistake_is_one_line(tmp_path):
    (tmp_path / "grid.yaml").write_text("placement: line\nscene: {towns: [Nowhere]}\n")
    (line,) = call(app, tmp_path / "grid.yaml", tmp_path, code=2).stderr.splitlines()
    assert line.startswith(f"{tmp_path}/grid.yaml: scene: no map 'Nowhere' in ")


def inner(points: np.ndarray) -> np.ndarray:
    """Points that are inside the crop on either grid."""
    low, high = np.array(CROP[:3]) + 0.005, np.array(CROP[3:]) - 0.005
    return points[((points[:, :3] > low) & (points[:, :3] < high)).all(axis=1)]


def test_recorded_clouds_take_the_place_of_simulated_ones(folder, recorded):
    """The stage gives the same points either way, to the millimetres of their grids."""
    log = read_box_log(folder / "logs" / "scene.density=30")
    scene = LogScene(source="log", folder=folder / "logs" / "scene.density=30")
    value = SceneStage(LogRecording(scene, scene.digest())).run()
    pd.testing.assert_frame_equal(value.boxes, log.boxes)
    pd.testing.assert_frame_equal(value.buildings, log.buildings)
    lidar = Lidar(tuple(np.radians([-9.0, -5.0, -2.0])), azimuth_steps=720)
    placement = PAPER_PLACEMENTS["line"].with_lidar(lidar)
    ours = CollectStage(placement, False, 1, "train", CROP, MountingErrors()).run(value)
    wide = (-1.0, -30.0, -1.0, 50.0, 30.0, 9.0)
    store = folder / "clouds" / "line"
    write_clouds(store / "route-0", collect(log, log.frames["frame"], placement, wide, seed=1))
    stage = RecordedCloudsStage(store, clouds_digest(store), split="train", crop=CROP)
    theirs = stage.run(value)
    with refused((str(store), "", "")):
        replace(stage, digest="another").run(value)
    numbers = log.frames.loc[log.frames["split"] == "train", "frame"].tolist()
    assert ours.frames.tolist() == theirs.frames.tolist() == numbers
    assert ours.counts.sum() > 500
    for a, b in zip(map(inner, ours), map(inner, theirs), strict=True):
        np.testing.assert_allclose(a[:, :3], b[:, :3], atol=0.002)
    objects = ours.points_per_object
    assert list(objects.columns) == ["frame", "object_id", "points"]
    assert set(objects["frame"]) <= set(numbers)
    assert objects["points"].sum() > 0
