"""Scan patterns fitted to clouds: our own simulator's come back, real ones as they were found."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount, Placement
from lidarplace.clouds.raycast import cast
from lidarplace.clouds.scan_fit import fit_scan
from lidarplace.clouds.shapes import bricks
from lidarplace.commands.sensors import app
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.rig_files.mounts_yaml import read_mounts_yaml
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.datasets.nuscenes import STEPS as NUSCENES_STEPS
from lidarplace.scenes.kitti.read import STEPS as KITTI_STEPS
from tests.lidarplace.recall.small_scenes import log_of
from tests.sweeps.toy import call

MOUNT = Mount.degrees(z=2.0, roll=4.0, pitch=3.0)
"""Tilted, so that every ring meets the ground at many distances."""
WALLS = bricks(
    np.array(
        [
            [15.0, 0.0, 10.0, 0.5, 60.0, 20.0, 0.0],
            [-25.0, 0.0, 10.0, 0.5, 60.0, 20.0, 0.0],
            [0.0, 9.0, 10.0, 60.0, 0.5, 20.0, 0.0],
            [0.0, -20.0, 10.0, 60.0, 0.5, 20.0, 0.0],
        ]
    ),
    0,
)
LIDAR = Lidar(tuple(np.radians([-14.0, -9.0, -5.5, -2.0, 1.0, 4.0])), 900, range_noise=0.02)
FACTS = json.loads((Path(__file__).parents[1] / "data" / "scan_fits.json").read_text("utf-8"))


def cloud_of(lidar: Lidar, mount: Mount = MOUNT, seed: int = 0, lost: float = 0.0) -> pd.DataFrame:
    """What the LiDAR returns, in its own frame, ring after ring."""
    rng = np.random.default_rng(seed)
    found = cast(mount, lidar, WALLS).range
    ring = np.arange(lidar.rays) // lidar.fired_steps
    ranges = found + lidar.range_noise * rng.standard_normal(lidar.rays)
    points = ranges[:, None] * lidar.directions()
    if lidar.offsets is not None:
        points[:, 2] += np.array(lidar.offsets)[ring]
    kept = np.isfinite(found) & (rng.random(lidar.rays) >= lost)
    cloud = pd.DataFrame(points[kept].astype(np.float32), columns=list("xyz"))
    return cloud.assign(ring=ring[kept])


def in_ego(cloud: pd.DataFrame, mount: Mount) -> pd.DataFrame:
    points = cloud[list("xyz")].to_numpy() @ mount.rotation.T + mount.position
    return cloud.assign(**dict(zip("xyz", points.T, strict=True)))


@st.composite
def patterns(draw) -> Lidar:
    beams = draw(st.integers(3, 24))
    gaps = draw(st.lists(st.floats(0.2, 2.0), min_size=beams, max_size=beams))
    elevations = draw(st.floats(-25.0, -8.0)) + np.cumsum(gaps)
    split = draw(st.integers(0, beams))
    low, high = draw(st.sampled_from([(0.0, 0.0), (0.12, 0.2), (-0.1, 0.05), (0.15, 0.15)]))
    offsets = (low,) * split + (high,) * (beams - split)
    return Lidar(
        tuple(np.radians(np.minimum(elevations, 30.0 + 0.2 * np.arange(beams)))),
        draw(st.integers(360, 2500)),
        range_noise=draw(st.floats(0.005, 0.04)),
        offsets=offsets if any(offsets) else None,
    )


@settings(max_examples=15, deadline=None)
@given(lidar=patterns(), lost=st.sampled_from([0.0, 0.3]), ordered=st.booleans())
def test_a_simulated_cloud_gives_its_lidar_back(lidar, lost, ordered):
    cloud = cloud_of(lidar, lost=lost)
    found = fit_scan({"cloud": cloud.drop(columns="ring") if ordered else cloud})
    np.testing.assert_allclose(
        np.degrees(found.elevations), np.degrees(lidar.elevations), atol=0.01
    )
    assert found.azimuth_steps == lidar.azimuth_steps
    assert found.range_noise == pytest.approx(lidar.range_noise, rel=0.2)
    assert found.offsets == pytest.approx(lidar.offsets, abs=0.005)
    assert found.share == pytest.approx(len(cloud) / lidar.rays)


def test_several_sweeps_and_what_is_not_finite():
    sweeps = [cloud_of(LIDAR, seed=seed, lost=0.2) for seed in range(3)]
    sweeps[1].loc[::7, "x"] = np.nan
    sweeps[2] = sweeps[2].assign(time=np.linspace(0, 0.05, len(sweeps[2])))
    found = fit_scan(dict(zip("abc", sweeps, strict=True)))
    np.testing.assert_allclose(found.elevations, LIDAR.elevations, atol=1e-4)
    assert found.azimuth_steps == LIDAR.azimuth_steps
    assert found.rate == pytest.approx(20.0)
    few = pd.concat([cloud_of(LIDAR), pd.DataFrame({"x": [5.0], "y": 0, "z": 1, "ring": 17})])
    assert fit_scan({"cloud": few}).left_out == (17,)
    in_order = cloud_of(LIDAR).query("ring != 2").drop(columns="ring")
    assert len(fit_scan({"cloud": in_order}).elevations) == 5


def run(*arguments, code=0):
    return call(app, *arguments, code=code)


def test_the_file_is_the_lidar_of_a_configuration(tmp_path):
    unit = replace(
        Lidar.named("hdl64e"), azimuth_steps=1000, range_noise=0.01, min_range=0.0, size=None
    )
    (tmp_path / "clouds").mkdir()
    for seed in range(12):
        cloud = cloud_of(unit, seed=seed, lost=0.5)
        cloud.to_parquet(tmp_path / "clouds" / f"{seed}.parquet")
    out = tmp_path / "lidar.yaml"
    result = run("fit", tmp_path / "clouds", "--like", "hdl64e", "--out", out)
    assert "fitted to 10 of 12 clouds" in result.stderr
    assert "it turns at about 20.3 Hz" in result.stderr
    assert "0.000 degrees in the median" in result.output
    lidar = SensorSettings.model_validate(yaml.safe_load(out.read_text())["lidar"]).lidar()
    assert lidar.azimuth_steps == 1000
    np.testing.assert_allclose(lidar.elevations, unit.elevations, atol=2e-5)
    assert lidar.offsets == pytest.approx(unit.offsets, abs=0.002)
    assert lidar.range_noise == pytest.approx(0.01, rel=0.2)


def test_a_rig_of_several_lidars(tmp_path):
    rig = {"top": Mount.degrees(1.0, 0.0, 2.0, 5, 3, 40), "low": Mount.degrees(1, 0.1, 1.8, 176, 2)}
    clouds = [
        in_ego(cloud_of(LIDAR, mount), mount).assign(lidar=number)
        for number, mount in enumerate(rig.values())
    ]
    pd.concat(clouds).to_parquet(tmp_path / "0.parquet")
    recorded = RecordedRig(tuple(rig), Placement("rig", list(rig.values()), LIDAR))
    log = log_of((0, "Car", 9.0, 2.0, 4.0, 1.8, 1.6, 0.3))
    frames = log.frames.assign(timestamp_s=0.0, route="a", split="train")
    boxes = log.boxes.assign(timestamp_s=0.0)
    write_box_log(tmp_path / "log", BoxLog(boxes, frames, rigs={"a": recorded}))
    out = tmp_path / "rig.yaml"
    run("fit", tmp_path / "0.parquet", "--rig", tmp_path / "log", "--out", out)
    for each, (name, mount) in zip(read_mounts_yaml(out), rig.items(), strict=True):
        assert each.name == name
        assert each.mount.x == pytest.approx(mount.x)
        lidar = each.model.lidar()
        np.testing.assert_allclose(lidar.elevations, LIDAR.elevations, atol=1e-4)
    run("fit", tmp_path / "0.parquet", "--rig", out)
    moved = [in_ego(cloud, Mount(x=1.4, z=-0.3)) for cloud in clouds]
    pd.concat(moved).to_parquet(tmp_path / "axle.parquet")
    origin = ("--origin", -1.4, 0, 0.3)
    run("fit", tmp_path / "axle.parquet", "--rig", out, *origin)
    for options, told in (
        ((), "2 LiDARs in one cloud"),
        (("--rig", out, "--mount", *"000000"), "leave --mount out"),
        (("--mount", 1, 0, 2, 5, 3, 40), "unknown LiDAR 1"),
        (("--rig", out, "--origin", -1.4, 0, 0.3), "found a start at (-0"),
    ):
        wrong = run("fit", tmp_path / "0.parquet", *options, code=2)
        assert told in wrong.stderr
        assert wrong.stderr.count("\n") == 1


def test_rings_beyond_the_model(tmp_path):
    clouds = cloud_of(Lidar.even(20, (-20, 5), 400))
    clouds.to_parquet(tmp_path / "0.parquet")
    wrong = run("fit", tmp_path / "0.parquet", "--like", "vlp16", code=2)
    assert "expected 0 to 15, found 19" in wrong.stderr
    run("fit", tmp_path, "--like", "mid40", code=2)
    run("fit", tmp_path / "none", code=2)
    (tmp_path / "empty").mkdir()
    assert "no clouds" in run("fit", tmp_path / "empty", code=2).stderr


@pytest.mark.parametrize("name", FACTS["lidars"])
def test_the_catalogue_agrees_with_real_clouds(name):
    own = FACTS["lidars"][name]
    lidar = Lidar.named(name)
    apart = np.abs(np.degrees(lidar.elevations) - own["elevations_deg"])
    assert np.median(apart) < own["median_deg"] + 0.001
    assert apart.max() < own["largest_deg"] + 0.001
    blocks = own["offsets_m"]
    assert (lidar.offsets is None) == (blocks is None)
    if blocks is not None:
        np.testing.assert_allclose(lidar.offsets, np.repeat(blocks, 32), atol=0.01)


def test_a_name_may_have_a_rate():
    steps = Lidar.named("HDL-32E @ 20 Hz").azimuth_steps
    assert steps == Lidar.named("hdl32e").azimuth_steps / 2
    assert FACTS["lidars"]["hdl32e"]["azimuth_steps"] == pytest.approx(steps, rel=0.01)
    assert Lidar.named("hdl32e@10hz") == Lidar.named("hdl32e")
    assert SensorSettings(name="hdl32e@20hz").lidar().azimuth_steps == steps


def test_the_rates_of_recorded_rigs():
    assert FACTS["lidars"]["hdl64e"]["azimuth_steps"] == pytest.approx(KITTI_STEPS, rel=0.005)
    assert FACTS["lidars"]["hdl32e"]["azimuth_steps"] == pytest.approx(NUSCENES_STEPS, rel=0.005)
    steps = Lidar.named("vlp32c").azimuth_steps
    assert FACTS["lidars"]["vlp32c"]["azimuth_steps"] == pytest.approx(steps, rel=0.01)
