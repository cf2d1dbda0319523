import math
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from small_log import write_small_log
from typer.testing import CliRunner

from lidarplace import Lidar
from sweeps.commands.run import app
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import read_plan

EXAMPLE = Path(__file__).parents[2] / "examples/grid.yaml"
BASE = {"placement": "line", "grid": {"placement": ["line", "center"], "seed": [1, 2]}}


@pytest.fixture
def config(tmp_path):
    def write(**changes):
        path = tmp_path / "grid.yaml"
        path.write_text(yaml.safe_dump(BASE | changes))
        return path

    return write


def test_the_example_is_valid():
    assert len(read_sweep(EXAMPLE).points) >= 4


def test_the_papers_training_settings_are_the_defaults(config):
    training = read_sweep(config()).points[0].point.training
    assert training.epochs == 10
    assert training.optimizer == "adam_onecycle"
    assert (training.lr, training.weight_decay, training.momentum) == (0.01, 0.01, 0.9)
    assert (training.moms, training.pct_start) == ((0.95, 0.85), 0.1)
    assert (training.div_factor, training.grad_norm_clip) == (10, 10)


def test_product_of_any_key_paths(config):
    path = config(
        grid={
            "placement": ["line", "center"],
            "scene.density": [40, 80],
            "training.lr": [0.01, 0.003],
            "lidar.azimuth_steps": [360],
            "surrogate.resolution": [0.2],
        }
    )
    sweep = read_sweep(path)
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
        with pytest.raises(ConfigError, match="no point of the grid is left"):
            read_sweep(path)
        return
    found = [(g.point.placement, g.point.seed) for g in read_sweep(path).points]
    assert sorted(found) == sorted(expected)


def test_overrides(config):
    sweep = read_sweep(config(), ["training.epochs=2", "grid.seed=[7]", "ray=debug"])
    assert [g.point.seed for g in sweep.points] == [7, 7]
    assert sweep.points[0].point.training.epochs == 2
    assert sweep.common.ray.address == "debug"


def test_field_of_view(config):
    lidars = [
        point.point.lidar.lidar()
        for point in read_sweep(
            config(
                grid={
                    "placement": ["line"],
                    "lidar.azimuth_deg": [[-180, 180], [-60, 60], [0, 360]],
                    "lidar.range": [100, 30],
                }
            )
        ).points
    ]
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
    ("changes", "message"),
    [
        ({"trainig": {}}, r"trainig: unknown key \(did you mean training\?\); allowed are "),
        ({"training": {"epoch": 2}}, r"training.epoch: unknown key \(did you mean epochs\?\)"),
        ({"training": {"epochs": "two"}}, "training.epochs: found 'two'; should be a valid int"),
        ({"roi": {"x": [40, 0]}}, r"roi.x: found \[40, 0\]; allowed is \[min, max\]"),
        ({"scene": {"test_routes": 0}}, "scene: no frame is in the test split; test_routes is 0,"),
        (
            {"scene": {"split": "paper", "frames_per_route": 9}},
            "scene: no frame is in the test split; frames_per_route is 9, .* allowed is at least",
        ),
        ({"scene": {"source": "kitty"}}, "scene: source is none of sumo, log"),
        (
            {"scene": {"source": "log", "foldr": "x"}},
            r"scene.folder: is missing|scene.foldr: unknown key \(did you mean folder",
        ),
        (
            {"scene": {"source": "log", "folder": "/no/such"}},
            "scene.folder: .*/no/such/frames.parquet: no such file",
        ),
        ({"scene": {"towns": ["Town.03"]}}, "scene.towns.*'Town.03' is no town; allowed are"),
        ({"lidar": {"profile": ["paper", "paper"]}}, "lidar.profile: found .*; should be 'paper'"),
        ({"roi": {"x": [0, 100]}}, "roi: simulated traffic is logged up to 60 m .* 102.0 m away"),
        ({"lidar": "vlp-61"}, r"lidar: no LiDAR is called 'vlp-61'; did you mean vlp16\?"),
        ({"lidar": {"name": "vlp61"}}, r"lidar: no LiDAR is called 'vlp61'; did you mean vlp16\?"),
        ({"grid": {"lidar": ["vlp16", "x"]}}, r"grid.lidar\[1\]: no LiDAR is called 'x'; allowed"),
        ({"lidar": {"name": "vlp16", "beams": 32}}, "lidar: beams: vlp16 has its own beams; elev"),
        ({"lidar": {"range_80": 90}}, "lidar: range_80 needs range_10"),
        ({"lidar": 16}, "lidar: found 16; should be a mapping of keys$"),
        ({"placements": []}, r"placements: found \[\]; should be a mapping$"),
        ({"requirements": 5}, "requirements: found 5; should be a list$"),
        ({"requirements": {"name": "a"}}, "requirements: should be a list$"),
        ({"classes": "Car"}, r"classes: found 'Car'; should be a list, such as \[Car\]$"),
        ({"classes": []}, r"classes: found \[\]; needs at least 1 item$"),
        ({"name": ""}, "name: found ''; should have at least 1 character$"),
        ({"output": 5}, "output: found 5; should be a path$"),
        (
            {"lidar": {"profile": "papr"}},
            "lidar.profile: found 'papr' .did you mean paper",
        ),
        (
            {"placements": {"twins": {"mounts": [{"z": 2}, {"z": 2}]}}},
            "placement 'twins': LiDARs 0 and 1 are both at",
        ),
        ({"placements": {"line": {"mounts": [{"z": 2}]}}}, "'line' is the paper's"),
        (
            {"grid": {"placement": ["lime"]}},
            "grid.placement: no placement 'lime' .did you mean line",
        ),
        ({"grid": {"seed": [1, -1]}}, r"grid.seed\[1\]: found -1; should be greater than"),
        ({"grid": {"seed": [1, 1]}}, "grid.seed: 1 is given twice"),
        ({"grid": {"scene.densty": [1]}}, r"grid.scene.densty\[0\]: unknown key"),
        ({"grid": {"seed": []}}, "grid.seed: found .*; allowed is a list"),
        (
            {"grid": {"surrogate.resolution": [0.1, 0.3]}},
            r"grid.surrogate.resolution\[1\]: ROI x is 40 m long, no multiple",
        ),
        (
            {"surrogate": {"resolution": 1e-6}},
            r"surrogate.resolution: 1e-06 m divides the ROI into 6.4e\+21 voxels; allowed are 2e",
        ),
        (
            {"grid": {"surrogate.resolution": [0.1, 0.01]}},
            r"grid.surrogate.resolution\[1\]: surrogate.resolution: 0.01 m divides .* 6.4e\+09 vox",
        ),
        ({"exclude": [{"seed": 9}]}, r"exclude\[0\].seed: found 9; allowed are \[1, 2\]"),
        ({"exclude": [{"lr": 9}]}, r"exclude\[0\].lr: no axis of the grid; allowed are placem"),
        ({"ray": "debgu"}, "ray.address: found 'debgu'; allowed are local"),
        (
            {"lidar": {"elevation_deg": [-100, 5]}},
            r"lidar.elevation_deg\[0\]: found -100; should be .* -90",
        ),
        (
            {"classes": ["Bus"]},
            "classes: found .*; simulated traffic has no Bus; it has Car, Cyclist",
        ),
        ({"classes": ["car"]}, r"simulated traffic has no car \(did you mean Car\?\)"),
        ({"classes": "Car"}, r"classes: found 'Car'; should be a list, such as \[Car\]"),
        ({"classes": ["two wheels"]}, r"classes\[0\]: found 'two wheels'; a class has a name of"),
        ({"classes": ["all"]}, r"classes\[0\]: .*'all' is no name of a class"),
        ({"class_settings": {"car": {}}}, r"class_settings: car is not among .*mean Car\?"),
        (
            {"class_settings": {"Car": {"iou": [0.5, 0.7]}}},
            r"class_settings.Car.iou: found \[0.5, 0.7\]; allowed is \[strict, loose\]",
        ),
        (
            {"class_settings": {"Car": {"size": [4, 2, 0]}}},
            r"class_settings.Car.size\[2\]: found 0",
        ),
        ({"class_settings": {"Car": {"colour": "red"}}}, "class_settings.Car.colour: found 'red'"),
        (
            {"training": {"sample_groups": {"Truk": 3}}},
            "training.sample_groups: Truk is not among classes",
        ),
        ({"detector": "yolo"}, "detector: found 'yolo'; should be 'pointpillars'"),
        (
            {"lidar": {"azimuth_deg": [60, -60]}},
            r"azimuth_deg: found \[60, -60\]; allowed is \[min",
        ),
        (
            {"lidar": {"azimuth_deg": [-200, 200]}},
            "allowed is .* with min < max and max - min <= 360",
        ),
        ({"lidar": {"azimuth_deg": [1, 1.01]}}, "lidar: none of the 5625 azimuth steps of a turn"),
        ({"name": "a/b"}, "name: found 'a/b'"),
        ({"seed": "banana"}, "seed: found 'banana'; should be a valid integer"),
        (
            {"placement": "lime"},
            "placement: no placement 'lime' .did you mean line",
        ),
        (
            {"scene": {"density": float("nan")}, "grid": {"scene.density": [3, 4]}},
            "scene.density: found nan; ",
        ),
        (
            {"training": {"epochs": -1}, "grid": {"training": [{"epochs": 1}, {"epochs": 2}]}},
            "training.epochs: found -1; should be greater than or equal to 1",
        ),
        ({"weather": {"visibility": 0}}, "weather.visibility: found 0; should be greater than 0"),
        ({"weather": {"rain": -1}}, "weather.rain: found -1; should be greater than or equal to 0"),
        ({"weather": {"snow": 1}}, "weather.snow: unknown key"),
        ({"lidar": {"window": 0}}, "lidar.window: found 0; should be greater than 0"),
        (
            {"lidar": {"range_10": 50, "range_80": 50}, "weather": {"rain": 4}},
            "range_80 is range_10, 50.*: light makes no difference",
        ),
        ({"scene": {"density": True}}, "scene.density: found True; should be a valid integer"),
        ({"training": {"lr": True}}, "training.lr: found True; should be a valid number"),
        ({"training": {"epochs": "3"}}, "training.epochs: found '3'; should be a valid integer"),
        ({"training": {"grad_norm_clip": float("inf")}}, "grad_norm_clip: found inf; .* finite"),
        ({"training": {"scaling": [1, float("nan")]}}, r"scaling\[1\]: found nan; .* finite"),
        ({"scene": {"routes": 10**30}}, "scene.routes: found 1000.*; should be less than"),
        ({"scene": {"warmup_s": 1e300}}, r"scene.warmup_s: found 1e\+300; should be less than"),
        ({"roi": {"x": [0, 1e308]}}, r"roi.x\[1\]: found 1e\+308; should be less than"),
        (
            {"placements": {"far": {"mounts": [{"z": 1e308}]}}},
            r"placements.far.mounts\[0\].z: found 1e\+308; should be less than or equal to 100",
        ),
        (
            {"placements": {"mm": {"mounts": [{"z": 2200}]}}},
            r"placements.mm.mounts\[0\].z: found 2200; should be less than or equal to 100",
        ),
        (
            {"placements": {"low": {"mounts": [{"z": -0.1}]}}},
            r"placements.low.mounts\[0\].z: found -0.1; should be greater than or equal to 0",
        ),
        (
            {"placements": {"long": {"mounts": [{"x": -2000, "z": 2}]}}},
            r"placements.long.mounts\[0\].x: found -2000; should be greater than or equal to -100",
        ),
        (
            {"lidar": {"elevation_deg": [5, -25]}},
            "lidar.elevation_deg: found .*; elevations count upwards",
        ),
        (
            {"lidar": {"elevations_deg": [5, 0, -25]}},
            "lidar.elevations_deg: found .*; elevations count upwards",
        ),
        (
            {"placements": {"turned": {"mounts": [{"z": 2, "roll": 28}]}}},
            r"placements.turned.mounts\[0\].roll: found 28; should be less than",
        ),
        (
            {"placements": {"many": {"mounts": [{"z": 2, "x": i} for i in range(1000)]}}},
            "placements.many.mounts: .* at most 100 items",
        ),
        ({"placements": {"p" * 10**6: {"mounts": [{"z": 2}]}}}, "placements.p{60}….*at most 100 c"),
        ({"name": "n" * 10**6}, "name: found 'nn.*at most 100 characters"),
        ({"output": "o" * 10**6}, "output: found 'oo.*allowed are 4000 bytes"),
        ({"lidar": {"beams": 10**6}}, "lidar.beams: found 1000000; .* less than or equal to 10000"),
        ({"lidar": {"elevations_deg": [0.1] * 10**5}}, "lidar.elevations_deg: .*at most 10000 it"),
        ({"lidar": {"azimuth_steps": 10**12}}, "lidar.azimuth_steps: found 1000000000000; .* less"),
        ({"lidar": {"azimuth_steps": 9 * 10**6}}, "lidar: azimuth_steps: .*16 beams; allowed are"),
        (
            {"grid": {"seed": list(range(3000)), "scene.seed": list(range(3000))}},
            "grid: found 9,000,000 points; allowed are 20,000",
        ),
        (
            {"grid": {"scene": [{"density": 3}], "scene.density": [4, 7]}},
            "grid.scene.density: is inside of scene, which is given too",
        ),
        (
            {
                "grid": {"training": [{"epochs": 5}]},
                "promote": [{"by": "recall", "keep": 1, "set": {"training.epochs": 1}}],
            },
            r"promote\[0\].set.training.epochs: is inside of training, an axis of the grid",
        ),
    ],
)
def test_mistakes_are_one_line_with_file_key_value_and_what_is_allowed(config, changes, message):
    path = config(**changes)
    with pytest.raises(ConfigError, match=message) as error:
        read_sweep(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 1000


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seed: [1", r"line \d+, column \d+: "),
        ("seed: 1\nseed: 2", "line 2, column 1: key 'seed' is given twice"),
        ("", "found nothing; a mapping of keys is expected"),
        ("- 1", "found list; a mapping of keys is expected"),
        ("a: !!python/object:os.system {}", r"line 1, column 4: tag .*os\.system' is not taken"),
    ],
)
def test_bad_yaml(tmp_path, text, message):
    path = tmp_path / "grid.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_sweep(path)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("seed", "expected KEY=VALUE"),
        ("seed=3", r"seed is an axis of the grid; use grid.seed=\[…\]"),
        ("sed=3", "did you mean seed"),
        ("training=[", "the value: .*: is not YAML"),
    ],
)
def test_bad_overrides(config, override, message):
    with pytest.raises(ConfigError, match=message):
        read_sweep(config(), [override])


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: cannot be read: No such file"):
        read_sweep(tmp_path / "nowhere.yaml")


def test_surrogates_alone_need_no_test_frames(tmp_path):
    """A table of boxes without splits is all training frames."""
    write_small_log(tmp_path / "log")
    frames = pd.read_parquet(tmp_path / "log/frames.parquet")
    frames.assign(split="train").to_parquet(tmp_path / "log/frames.parquet", index=False)
    path = tmp_path / "s.yaml"
    content = {
        "scene": {"source": "log", "folder": str(tmp_path / "log")},
        "detector": None,
        "grid": {"placement": ["line", "center"]},
    }
    path.write_text(yaml.safe_dump(content))
    assert len(read_plan(path)[1].trials) == 2
    with pytest.raises(ConfigError, match="no frame is in the test split"):
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
    sweep = read_sweep(path, ["scene={routes: 3}"])
    assert [(p.point.scene.density, p.point.scene.routes) for p in sweep.points] == [(4, 3), (7, 3)]
    with pytest.raises(ConfigError, match="scene is an axis of the grid"):
        read_sweep(config(grid={"scene": [{"density": 3}]}), ["scene.routes=3"])


def test_a_value_without_its_equals_sign_is_no_argument_too_many():
    done = CliRunner().invoke(app, ["grid.yaml", "--set", "training.epochs", "2"])
    assert done.exit_code == 2
    told = "expected KEY=VALUE, with = between them, such as --set training.epochs=3"
    assert done.stderr == f"--set training.epochs: {told}\n"
