import math
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from lidarplace import Lidar
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import read_plan
from tests.refused import refused
from tests.sweeps.small_log import write_sweep

EXAMPLE = Path(__file__).parents[2] / "examples/grid.yaml"
BASE = {"placement": "line", "grid": {"placement": ["line", "center"], "seed": [1, 2]}}


@pytest.fixture
def config(tmp_path):
    def write(**changes):
        path = tmp_path / "grid.yaml"
        path.write_text(yaml.safe_dump(BASE | changes))
        return path

    return write


def test_the_papers_training_settings_are_the_defaults(config):
    assert len(read_sweep(EXAMPLE).points) >= 4
    training = read_sweep(config()).points[0].point.training
    assert training.epochs == 10
    assert training.optimizer == "adam_onecycle"
    assert (training.lr, training.weight_decay, training.momentum) == (0.01, 0.01, 0.9)
    assert (training.moms, training.pct_start) == ((0.95, 0.85), 0.1)
    assert (training.div_factor, training.grad_norm_clip) == (10, 10)


def test_product_of_any_key_paths(config):
    grid = {"placement": ["line", "center"], "scene.density": [40, 80]}
    grid |= {"training.lr": [0.01, 0.003], "lidar.azimuth_steps": [360]}
    sweep = read_sweep(config(grid=grid | {"surrogate.resolution": [0.2]}))
    assert len(sweep.points) == 8
    last = sweep.points[-1].point
    assert (last.placement, last.scene.density, last.training.lr) == ("center", 80, 0.003)
    assert (last.lidar.azimuth_steps, last.surrogate.resolution) == (360, 0.2)


@given(
    st.lists(st.sampled_from(["line", "center", "square"]), min_size=1, max_size=3, unique=True),
    st.lists(st.integers(0, 9), min_size=1, max_size=4, unique=True),
    st.integers(0, 9),
)
def test_exclusions_leave_out_just_what_they_name(tmp_path_factory, placements, seeds, excluded):
    path = tmp_path_factory.mktemp("grid") / "grid.yaml"
    rules = [{"placement": placements[0], "seed": excluded}] if excluded in seeds else []
    path.write_text(
        yaml.safe_dump({"grid": {"placement": placements, "seed": seeds}, "exclude": rules})
    )
    expected = {(p, s) for p in placements for s in seeds}
    if rules:
        expected -= {(placements[0], excluded)}
    if not expected:
        with refused(("grid.yaml", "exclude", "")):
            read_sweep(path)
        return
    found = [(g.point.placement, g.point.seed) for g in read_sweep(path).points]
    assert sorted(found) == sorted(expected)


def test_field_of_view(config):
    grid = {"placement": ["line"], "lidar.azimuth_deg": [[-180, 180], [-60, 60], [0, 360]]}
    sweep = read_sweep(config(grid=grid | {"lidar.range": [100, 30]}))
    lidars = [point.point.lidar.lidar() for point in sweep.points]
    assert lidars[0] == Lidar.paper()
    assert [lidar.full_turn for lidar in lidars] == [True, True, False, False, True, True]
    assert lidars[2].azimuth == (math.radians(-60), math.radians(60))
    assert lidars[3].range == 30


def test_lidars_by_name(config):
    def lidars(**changes):
        return [p.point.lidar.lidar() for p in read_sweep(config(**changes)).points]

    line = {"placement": ["line"]}
    vlp16, at128 = Lidar.named("vlp16"), Lidar.named("at128")
    assert lidars(lidar="VLP-16", grid=line) == [vlp16]
    assert lidars(grid=line | {"lidar": ["vlp16", "at128"]}) == [vlp16, at128]
    assert lidars(grid=line | {"lidar.name": ["vlp16", "at128"]}) == [vlp16, at128]
    given = {"name": "at128", "cloud_share": 0.2, "range": 50, "azimuth_deg": [-30, 30]}
    (point,) = read_sweep(config(lidar=given, grid=line)).points
    assert point.point.lidar.cloud_share == 0.2
    front = replace(at128, range=50, azimuth=(math.radians(-30), math.radians(30)))
    assert point.point.lidar.lidar() == front
    own = {key: value for key, value in given.items() if key != "cloud_share"}
    mounts = [{"z": 2}, {"x": 1, "z": 2, "lidar": "vlp16"}, {"x": 2, "z": 2, "lidar": own}]
    (point,) = read_sweep(
        config(lidar="at128", placements={"a": {"mounts": mounts}}, grid={"placement": ["a"]})
    ).points
    assert point.rig.lidars == (at128, vlp16, front)


def test_noise_and_lost_returns_are_of_all_lidars_that_lack_them(config):
    """The data sheet of `os1_64_gen1` has a range noise, that of `vlp16` none."""
    models = ["vlp16", "os1_64_gen1", {"name": "vlp16", "drop_off": 0}]
    mounts = [{"z": 2}, *({"x": x, "z": 2, "lidar": lidar} for x, lidar in enumerate(models, 1))]
    lidar = {"name": "at128", "range_noise": 0.02}
    grid = {"placement": ["a"], "lidar.drop_off": [0.05, 0.1]}
    sweep = read_sweep(config(lidar=lidar, placements={"a": {"mounts": mounts}}, grid=grid))
    for point, lost in zip(sweep.points, (0.05, 0.1), strict=True):
        losses = [(lidar.range_noise, lidar.drop_off) for lidar in point.rig.lidars]
        assert losses == [(0.02, lost), (0.02, lost), (0.03, lost), (0.02, 0)]
    (point,) = read_sweep(
        config(lidar="os1_64_gen1", placements={"a": {"mounts": mounts}}, grid={"placement": ["a"]})
    ).points
    assert point.rig.lidars[1].range_noise == 0, "not that of another data sheet"


def test_a_profile_fills_what_is_not_given(config):
    given = {"profile": "released-code", "misaligned_heights": False, "range": 50}
    sweep = read_sweep(config(lidar=given, grid={"placement": ["line"]}))
    settings = sweep.points[0].point.lidar
    assert (settings.azimuth_steps, settings.range) == (250, 50)
    assert settings.lidar().rays == 4000
    assert settings.tilt_in_degrees
    assert not settings.misaligned_heights


def test_own_placements_in_both_conventions(config):
    carla = {"convention": "carla", "mounts": [{"x": 1, "y": 0.5, "z": 2, "pitch": 0.1}]}
    ego = {"mounts": [{"x": 1, "y": -0.5, "z": 2, "pitch": -0.1}]}
    sweep = read_sweep(config(placements={"a": carla, "b": ego}, grid={"placement": ["a", "b"]}))
    a, b = (point.rig for point in sweep.points)
    assert a.mounts == b.mounts


@pytest.mark.parametrize(
    ("key", "changes"),
    [
        ("detector", {"detector": "yolo"}),
        ("placements.m.mounts", {"placements": {"m": {"mounts": [{"z": i} for i in range(1000)]}}}),
        (f"placements.{'p' * 60}…", {"placements": {"p" * 10**6: {"mounts": [{"z": 2}]}}}),
        ("name", {"name": "n" * 10**6}),
        ("output", {"output": "o" * 10**6}),
        ("lidar.elevations_deg", {"lidar": {"elevations_deg": [0.1] * 10**5}}),
        ("grid", {"grid": {"seed": list(range(3000)), "scene.seed": list(range(3000))}}),
    ],
)
def test_a_mistake_of_any_size_is_one_line(config, key, changes):
    path = config(**changes)
    with pytest.raises(ConfigError) as error:
        read_sweep(path)
    assert (error.value.place, error.value.key) == (str(path), key)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 1000


def test_surrogates_alone_need_no_test_frames(tmp_path):
    """A table of boxes without splits is all training frames."""
    path = write_sweep(tmp_path, detector=None, grid={"placement": ["line", "center"]})
    frames = pd.read_parquet(tmp_path / "log/frames.parquet")
    frames.assign(split="train").to_parquet(tmp_path / "log/frames.parquet", index=False)
    assert len(read_plan(path)[1].trials) == 2
    with refused((str(path), "scene", "")):
        read_plan(path, ["detector=pointpillars_tiny"])


def test_a_change_is_of_one_placement_though_an_alias_names_both(tmp_path):
    path = tmp_path / "aliases.yaml"
    path.write_text("placement: a\nplacements: {a: &m {mounts: [{z: 2, y: 1}]}, b: *m}")
    found = read_sweep(path, ["placements.a.convention=carla"]).common.placements
    assert {name: own.convention for name, own in found.items()} == {"a": "carla", "b": "ego"}


def test_what_is_written_as_the_configuration_has_no_value_of_an_axis(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("placement: line\nscene: {density: 9}\ngrid: {scene.density: [4, 7]}")
    sweep = read_sweep(path)
    assert sweep.source["scene"] == {"density": 9}
    assert [point.point.scene.density for point in sweep.points] == [4, 7]


def test_an_axis_inside_of_a_key_of_the_command_line_keeps_its_values(config):
    path = config(grid={"placement": ["line"], "scene.density": [4, 7]})
    sweep = read_sweep(path, ["scene={routes: 3}", "grid.seed=[7]", "ray=debug"])
    assert sweep.common.ray.address == "debug"
    assert {p.point.seed for p in sweep.points} == {7}
    assert [(p.point.scene.density, p.point.scene.routes) for p in sweep.points] == [(4, 3), (7, 3)]
