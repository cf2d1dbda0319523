"""LiDARs from their makers' files, and beams that fire beside the azimuth steps."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from lidarplace.base.roi import Roi
from lidarplace.clouds.raycast import beams_of, cast, expected_share
from lidarplace.clouds.shapes import bricks
from lidarplace.commands.sensors import app
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.coverage import coverage
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.requirements.rays_on_objects import count_points, sights_of
from lidarplace.rig_files.maker_files import read_maker_file
from lidarplace.rigs.correction import Correction, Mask
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement, blocks
from tests.lidarplace.recall.small_scenes import log_of
from tests.lidarplace.test_laser_offsets import BOXES, LIDAR, NOBODY, ROI, mounts
from tests.sweeps.toy import call

MAKERS = Path(__file__).parents[1] / "data/makers"
STEP = 2 * math.pi / LIDAR.azimuth_steps
steps_of_all = st.tuples(*[st.integers(-120, 120)] * LIDAR.beams)


def beside(steps):
    """The LiDAR with beams so many whole steps beside: its rays are those of the plain one."""
    return replace(LIDAR, azimuth_offsets=[STEP * step for step in steps])


@settings(max_examples=10, deadline=None)
@given(mount=mounts, steps=steps_of_all)
def test_whole_steps_shift_the_rays_of_a_beam(mount, steps):
    shifted, parts = beside(steps), bricks(BOXES, 0)
    plain, hits = cast(mount, LIDAR, parts), cast(mount, shifted, parts)
    for name in ("range", "reflected"):
        rows = getattr(plain, name).reshape(LIDAR.beams, -1)
        expected = [np.roll(row, -step) for row, step in zip(rows, steps, strict=True)]
        found = getattr(hits, name).reshape(LIDAR.beams, -1)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    ways = [each.directions().reshape(LIDAR.beams, -1, 3) for each in (LIDAR, shifted)]
    expected = [np.roll(row, -step, axis=0) for row, step in zip(ways[0], steps, strict=True)]
    np.testing.assert_allclose(ways[1], expected, atol=1e-12)


@settings(max_examples=5, deadline=None)
@given(mount=mounts, steps=steps_of_all)
def test_rays_that_are_only_shifted_count_the_same(mount, steps):
    plain, shifted = (Placement("rig", [mount], each) for each in (LIDAR, beside(steps)))
    for method in ("cone", "dda"):
        np.testing.assert_array_equal(coverage(shifted, ROI, method), coverage(plain, ROI, method))
    points = [count_points(sights_of(rig, NOBODY), BOXES) for rig in (plain, shifted)]
    np.testing.assert_allclose(points[0], points[1], rtol=1e-12)
    wide, row = Roi((-30, 30), (-30, 30), (0, 4), 0.5), (0, "Tram", 9.0, 2.0, 4.0, 1.8, 1.6, 0.3)
    objects = CountedObjects.from_log(log_of(row), wide, ["Tram"], 0.3, vehicle=NOBODY)
    seen = objects.seen_by([plain, shifted])
    assert seen[0].points.tolist() == seen[1].points.tolist()


def test_a_field_of_view_and_a_mask_turn_with_the_beam():
    part = replace(LIDAR, azimuth=(-20 * STEP, 20 * STEP), azimuth_offsets=[30 * STEP] * 5)
    turned = replace(LIDAR, azimuth=(10 * STEP, 50 * STEP))
    np.testing.assert_allclose(part.directions(), turned.directions(), atol=1e-12)
    shares = tuple(n / 12 for n in range(1, 13))  # of 30 degrees each
    masked = replace(LIDAR, correction=Correction(mask=Mask((shares,))))
    ((_, block, _),) = blocks(Mount(z=2.0), replace(masked, azimuth_offsets=[20 * STEP] * 5))
    expected = np.roll(beams_of(masked).mask.reshape(5, -1), -20, axis=1)
    np.testing.assert_array_equal(beams_of(block).mask.reshape(5, -1), expected)


def test_a_few_beams_beside_the_steps_meet_what_others_miss():
    """Four rays a turn: 20 degrees to the left is a post, straight ahead nothing."""
    few = Lidar((0.0,), 4, range=60.0)
    aside = replace(few, azimuth_offsets=[math.radians(20)])
    x, y = 10 * math.cos(math.radians(20)), 10 * math.sin(math.radians(20))
    post, mount = np.array([[x, y, 1.0, 0.3, 0.3, 2.0, 0.0]]), Mount(z=1.0)
    counts = [
        count_points(sights_of(Placement("a", [mount], each), NOBODY), post)[0, 0]
        for each in (few, aside)
    ]
    assert counts == [0, 1]


def test_settings_have_offsets_of_azimuth():
    model = SensorSettings(elevations_deg=(-2.0, 1.0), azimuth_offsets_deg=(3.0, -3.0)).lidar()
    np.testing.assert_allclose(np.degrees(model.azimuth_offsets), [3.0, -3.0])
    for wrong, message in (((1.0,), "one for each of 2 beams"), ((200.0, 0.0), "180")):
        with pytest.raises(ValidationError, match=f"azimuth_offsets(?s:.*){message}"):
            SensorSettings(elevations_deg=(-2.0, 1.0), azimuth_offsets_deg=wrong)


def imported(path, *words):
    """The LiDAR that the command writes, and what it prints."""
    done = call(app, "import", path, *words)
    text = done.stdout[done.stdout.index("lidar:") :]
    return SensorSettings.model_validate(yaml.safe_load(text)["lidar"]), done.stdout


def test_ouster(tmp_path):
    model, text = imported(MAKERS / "os0.json")
    content = json.loads((MAKERS / "os0.json").read_text())
    altitudes = content["beam_intrinsics"]["beam_altitude_angles"]
    np.testing.assert_allclose(model.elevations_deg, altitudes[::-1])
    assert model.azimuth_steps == 1024
    # Ouster's azimuths are clockwise: the top beam fires 10.86 degrees to the right.
    assert model.azimuth_offsets_deg[-1] == -10.86
    assert "left out: beams start 27.116 mm off the axis" in text
    # The encoder turns clockwise from straight back; columns 256 to 767 are the front half.
    content["lidar_data_format"]["column_window"] = [256, 767]
    path = tmp_path / "front.json"
    path.write_text(json.dumps(content))
    assert imported(path)[0].azimuth_deg == (-90.0, 90.0)


def test_velodyne(tmp_path):
    model, _ = imported(MAKERS / "vlp4db.yaml")
    np.testing.assert_allclose(model.elevations_deg, [-15, -13, 1, 3], atol=1e-3)
    assert model.azimuth_offsets_deg is None
    whole = read_maker_file(MAKERS / "hdl3.xml")
    assert whole.elevations_deg.tolist() == [-8.5, -7.25]  # the third is not enabled
    assert whole.azimuth_offsets_deg.tolist() == [3.25, -5.5]
    np.testing.assert_allclose(whole.offsets_m, [0.16, 0.215])
    assert whole.left_out == ("lasers are up to 26 mm beside the axis",)
    # All beams of a VLP-16, a hair off the data sheet: its ranges and steps are taken.
    lasers = [
        {"laser_id": n, "rot_correction": 0.02, "vert_correction": e + 0.001}
        for n, e in enumerate(Lidar.named("vlp16").elevations[::-1])
    ]
    (tmp_path / "a.yaml").write_text(yaml.safe_dump({"lasers": lasers}))
    out = tmp_path / "lidar.yaml"
    done = call(app, "import", tmp_path / "a.yaml", "--out", out)
    assert "0.057, at most 0.057" in done.stdout
    assert "azimuth steps and ranges are those of vlp16" in done.stdout
    keys = yaml.safe_load(out.read_text())["lidar"]
    assert keys["name"] == "vlp16"
    lidar = SensorSettings.model_validate(keys).lidar()
    assert lidar.azimuth_steps == Lidar.named("vlp16").azimuth_steps
    # Subtracted from azimuths that count clockwise: to the left.
    np.testing.assert_allclose(lidar.azimuth_offsets, [0.02] * 16, atol=1e-4)


def test_a_vertical_offset_of_velodyne_is_at_right_angles_to_the_ray(tmp_path):
    """velodyne_pointcloud: xy = d cos(v) - o sin(v), z = d sin(v) + o cos(v)."""
    angle, offset = math.radians(-24.0), 0.2
    laser = {"rot_correction": 0.0, "vert_correction": angle, "vert_offset_correction": offset}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump({"lasers": [laser]}))
    (start,) = read_maker_file(tmp_path / "a.yaml").offsets_m
    xy = 30.0 * math.cos(angle) - offset * math.sin(angle)
    z = 30.0 * math.sin(angle) + offset * math.cos(angle)
    assert start + xy * math.tan(angle) == pytest.approx(z)


def test_a_mask_turns_with_the_beam_in_shares_of_returns_too():
    shares = tuple(n / 12 for n in range(1, 13))
    lidar = replace(beside([20] * 5), correction=Correction(mask=Mask((shares,))))
    rays = np.arange(lidar.rays)
    x, y, _ = lidar.directions().T
    expected = Mask((shares,)).at(np.arctan2(y, x), np.zeros(len(x)))
    found = expected_share(lidar, "Car", rays, np.ones(len(rays)))
    np.testing.assert_allclose(found, expected * (1 - lidar.drop_off))


def test_hesai():
    model, text = imported(MAKERS / "xt32.csv", "--like", "xt32")
    assert model.azimuth_offsets_deg[0] == -0.752
    assert model.elevations_deg[-1] == 14.966
    assert model.range == SensorSettings(name="xt32").range
    assert "xt32" in text


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.txt", "", "unknown format; expected .json"),
        ("a.json", "[]", "expected an object"),
        ("a.json", "{}", "beam_altitude_angles: expected a list of numbers, found none"),
        ("a.json", '{"beam_altitude_angles": [1, true]}', "expected a list of numbers"),
        ("a.json", '{"beam_altitude_angles": [1], "beam_azimuth_angles": []}', "1 to 1024 beams"),
        (
            "a.json",
            '{"beam_altitude_angles": [91], "beam_azimuth_angles": [0]}',
            "elevation of beam 1: expected degrees within ±90, found 91",
        ),
        ("a.yaml", "a: 1", "lasers: expected a list of lasers, found a"),
        ("a.yaml", "lasers: [{rot_correction: 0}]", "vert_correction: expected a list of numbers"),
        ("a.xml", "<a/>", "no laser"),
        ("a.xml", "<a><px><vertCorrection_>x</vertCorrection_></px></a>", "px 0: expected numbers"),
        ("a.csv", "Channel,Elevation\n1,2\n", "no column azimuth; expected columns Channel"),
        ("a.csv", "Channel,Elevation,Azimuth\n1,x,2\n", "row 0: elevation: "),
        ("a.csv", "Channel,Elevation,Azimuth\n", "expected 1 to 1024 beams"),
    ],
)
def test_wrong_files(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    done = call(app, "import", tmp_path / name, code=2)
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
