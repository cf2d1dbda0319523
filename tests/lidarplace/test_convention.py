"""Conventions: boxes written in any of them are read as they were, and label files in many."""

import json
import math
from collections import Counter
from itertools import permutations, product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from lidarplace.base.errors import InputError
from lidarplace.commands.convert import app
from lidarplace.configuration.yaml import parse_yaml
from lidarplace.logs.boxes import GEOMETRY, SIZE
from lidarplace.logs.convention import ANCHORS, CARLA_AXES, Convention, anchor_of
from lidarplace.rigs.pose import from_carla
from lidarplace.scenes.label_tables.files import read_label_file
from lidarplace.scenes.label_tables.mapping import TableMapping
from lidarplace.scenes.label_tables.propose import propose_mapping
from lidarplace.scenes.label_tables.read import read_label_table
from tests.lidarplace.company_table import DIRECTIONS, Manner, in_axes, traffic, write_in_manner
from tests.sweeps.toy import call

LABELS = Path(__file__).parents[1] / "data/labels"
AXES = [
    axes
    for each in permutations([("forward", "back"), ("left", "right"), ("up", "down")])
    for axes in product(*each)
]
ANCHOR_WORDS = ["centre", "bottom", "top", "front", "rear left bottom", "front right top"]


@settings(max_examples=100)
@given(
    axes=st.sampled_from(AXES),
    zero=st.sampled_from(["x", "-x", "y", "-y", "z", "-z"]),
    sense=st.sampled_from([None, "clockwise", "counterclockwise"]),
    radians=st.sampled_from([1.0, math.pi / 180]),
    metres=st.sampled_from([1.0, 1e-3]),
    size=st.sampled_from([1.0, 2.0, 0.01]),
    anchor=st.sampled_from(ANCHOR_WORDS),
    seed=st.integers(0, 1000),
)
def test_boxes_come_back(axes, zero, sense, radians, metres, size, anchor, seed):
    try:
        plain = Convention.of(axes, zero, sense, radians)
    except InputError:
        upright = axes.index("up" if "up" in axes else "down")
        assert zero[-1] == "xyz"[upright]
        return
    convention = Convention(axes, plain.factor, plain.turn, metres, size, anchor_of(anchor))
    boxes = np.random.default_rng(seed).uniform(0.5, 6, (5, 7))
    written = convention.written(boxes)
    read = convention.boxes(written[:, :3], written[:, 3:6], convention.yaws(written[:, 6]))
    np.testing.assert_allclose(read, boxes, atol=1e-9)
    assert Convention.of(axes, plain.zero, plain.sense, radians) == plain
    assert convention.zero == zero
    fronts = np.stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6]), np.zeros(5)], axis=1)
    along = convention.yaws_along(in_axes(fronts, axes))
    np.testing.assert_allclose(np.remainder(along - boxes[:, 6] + 1, 2 * math.pi), 1, atol=1e-9)


def test_one_convention_after_another():
    first, second = Convention.of(AXES[5], "y"), Convention.of(CARLA_AXES, "-y", "clockwise")
    places = np.random.default_rng(0).normal(size=(4, 3))
    both = second.after(first)
    np.testing.assert_allclose(both.places(places), second.places(first.places(places)))
    np.testing.assert_allclose(
        np.remainder(both.yaws(places[:, 0]) - second.yaws(first.yaws(places[:, 0])) + 1, math.tau),
        1,
    )


def test_carla_is_as_in_placements():
    """`from_carla` is tested against CARLA's own matrices."""
    x, y, z, _, _, yaw = from_carla(1.0, 2.0, 3.0, yaw=0.4)
    carla = Convention.of(CARLA_AXES)
    assert carla.places([[1.0, 2.0, 3.0]]).tolist() == [[x, y, z]]
    assert carla.yaws([0.4]).tolist() == [yaw]


def test_a_compass_and_a_camera():
    """North-east is 45 degrees; KITTI's rotation_y of a car that drives away is -pi / 2."""
    compass = Convention.of(("forward", "left", "up"), "y", "clockwise", math.pi / 180)
    assert compass.yaws(45.0) == pytest.approx(math.pi / 4)
    camera = Convention.of(("right", "down", "forward"))
    assert camera.yaws(-math.pi / 2) == pytest.approx(0.0)
    assert camera.places([[1.0, 2.0, 20.0]]).tolist() == [[20.0, -1.0, -2.0]]


def test_wrong_words():
    for axes, zero in ((("forward", "back", "up"), "x"), (("forward", "left", "up"), "z")):
        with pytest.raises(InputError):
            Convention.of(axes, zero)
    for words in ("", "middle", "rear front", "bottom bottom"):
        with pytest.raises(InputError):
            anchor_of(words)
    assert {*DIRECTIONS} == {axis for axes in AXES for axis in axes}
    assert {word for text in ANCHOR_WORDS for word in text.split()} == {*ANCHORS}


@pytest.mark.parametrize(
    ("angle", "zero", "sense"),
    product(["rad", "deg"], ["x", "y"], ["counterclockwise", "clockwise"]),
)
def test_the_convention_of_yaw_is_guessed(tmp_path, angle, zero, sense):
    log = traffic(3, drives=4, frames=12, objects=9)
    manner = Manner(angle=angle, zero=zero, sense=sense, origin=(0.0, 0.0, 0.0))
    write_in_manner(log, manner).to_csv(tmp_path / "labels.csv", index=False)
    guess = parse_yaml(propose_mapping(tmp_path / "labels.csv"))
    assert guess["yaw"] == {"zero": zero, "sense": sense}
    assert guess["units"]["angle"] == angle


@pytest.mark.parametrize("axes", [("forward", "left", "up"), ("right", "forward", "up")])
@pytest.mark.parametrize("coordinates", ["ego", "world"])
def test_axes_are_guessed(tmp_path, axes, coordinates):
    log = traffic(3, drives=2, frames=12, objects=9, straight=True)
    log.boxes["y"] *= 0.2  # a street
    manner = Manner(axes=axes, zero="x", origin=(0.0, 0.0, 0.0), coordinates=coordinates)
    table = write_in_manner(log, manner)
    if coordinates == "world":  # poses of the file's vehicle frame
        forward = {"x": 0.0, "y": -90.0}["xy"[axes.index("forward")]]
        table["host_heading"] += forward
    table.to_csv(tmp_path / "labels.csv", index=False)
    guess = parse_yaml(propose_mapping(tmp_path / "labels.csv"))
    assert tuple(guess["axes"].values()) == axes


def test_cases_of_the_field(tmp_path):
    """Files as people have them: the proposal of each reads it right."""
    for name in ("quaternions", "half_extents", "iso_times"):
        boxes = converted(LABELS / f"{name}.csv", tmp_path / name)
        np.testing.assert_allclose(boxes[["length", "width", "height"]].median(), [4.5, 1.9, 1.6])
        yaw = pd.read_csv(LABELS / "iso_times.csv", dtype={"id": str}).sort_values(["frame", "id"])
        boxes = boxes.sort_values(["frame", "object_id"])
        off = np.remainder(boxes["yaw"].to_numpy() - yaw["yaw"].to_numpy() + 1, math.tau)
        np.testing.assert_allclose(off, 1, atol=1e-4)
        assert boxes["timestamp_s"].drop_duplicates().diff().dropna().unique().tolist() == [0.5]
    boxes = converted(LABELS / "once_axes.csv", tmp_path / "once")
    assert boxes[["x", "y", "yaw"]].iloc[0].tolist() == pytest.approx([20.0, 0.0, 0.0])


def converted(labels, folder):
    folder.mkdir()
    call(app, "table", labels, "--propose", folder / "map.yaml")
    call(app, "table", labels, folder / "log", "--mapping", folder / "map.yaml")
    return pd.read_parquet(folder / "log/boxes.parquet")


def test_other_conventions_are_refused_with_the_keys_that_mend_them(tmp_path):
    guess = parse_yaml(propose_mapping(LABELS / "once_axes.csv"))
    for key, wrong, message in (
        ("axes", {"x": "forward"}, "axes: {x: right, y: forward, z: up}"),
        ("units", {"time": "iso"}, "expected a date of ISO 8601, found 0.0"),
        (
            "columns",
            guess["columns"] | {"yaw": None},
            "write the column of yaw, or replace `yaw` by",
        ),
        ("yaw", {"zero": "z"}, "yaw.zero: expected a level axis, found z"),
        ("axes", {"x": "left"}, "axes: expected one axis along the vehicle"),
        ("yaw", {"sense": None}, "--preview PAGE draws both"),
        ("anchor", "corner", "anchor: expected centre, or words"),
        (
            "columns",
            {**guess["columns"], "yaw": None, "direction": {"x": "cx", "y": "cy"}},
            "yaw.sense: applies only to a column yaw; found ",
        ),
        ("convention", "carla", "convention: already decides the axes"),
    ):
        (tmp_path / "map.yaml").write_text(json.dumps(guess | {key: wrong}))
        map_, log = tmp_path / "map.yaml", tmp_path / "log"
        done = call(app, "table", LABELS / "once_axes.csv", log, "--mapping", map_, code=2)
        assert message in done.stderr
        assert done.stderr.count("\n") == 1


def test_both_candidates_are_drawn(tmp_path):
    """Without ids nothing tells clockwise from counterclockwise."""
    table = pd.read_csv(LABELS / "iso_times.csv").drop(columns="id")
    table.to_csv(tmp_path / "labels.csv", index=False)
    text = propose_mapping(tmp_path / "labels.csv")
    assert parse_yaml(text)["yaw"] == {"zero": "x", "sense": None}
    (tmp_path / "map.yaml").write_text(text)
    page = tmp_path / "page.html"
    done = call(
        app,
        *("table", tmp_path / "labels.csv", "--mapping", tmp_path / "map.yaml"),
        *("--preview", page),
        code=2,
    )
    assert "yaw.sense" in done.stderr
    for sense in ("counterclockwise", "clockwise"):
        assert f"{sense}: log, frame 0" in page.read_text()


def test_a_quaternion_must_be_one_and_a_direction_not_zero(tmp_path):
    table = pd.read_csv(LABELS / "quaternions.csv")
    mapping = parse_yaml(propose_mapping(LABELS / "quaternions.csv"))
    table["qw"] *= 1.005  # within 1 %
    table.to_csv(tmp_path / "a.csv", index=False)
    log = read_label_table(tmp_path / "a.csv", TableMapping.model_validate(mapping), Counter())
    assert log.boxes["yaw"].iloc[0] == pytest.approx(2 * math.atan2(0.247404, 1.005 * 0.968912))
    table.loc[3, "qw"] = 0.8
    table.to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(InputError, match=r"row 3: .*expected length 1 within 1 %"):
        read_label_table(tmp_path / "a.csv", TableMapping.model_validate(mapping), Counter())
    mapping["columns"].pop("quaternion")
    mapping["columns"]["direction"] = {"x": "qx", "y": "qy"}
    with pytest.raises(InputError, match="row 0: qx, qy: the direction is 0 along the ground"):
        read_label_table(tmp_path / "a.csv", TableMapping.model_validate(mapping), Counter())


@pytest.mark.parametrize(
    ("name", "box", "frames"),
    [
        ("labelcloud", (12.0, -2.0, 0.8, 4.5, 1.9, 1.6, math.radians(30)), [0, 0]),
        ("sustech", (10.0, 2.0, 0.8, 4.5, 1.9, 1.6, 0.3), [0, 1]),
    ],
)
def test_a_json_file_a_frame(name, box, frames):
    mapping = parse_yaml(propose_mapping(LABELS / name))
    mapping["yaw"] = {}
    mapping["units"]["angle"] = "deg" if name == "labelcloud" else "rad"
    log = read_label_table(LABELS / name, TableMapping.model_validate(mapping), Counter())
    np.testing.assert_allclose(log.boxes[list(GEOMETRY)].iloc[0], box)
    empty = ~log.frames["frame"].isin(log.boxes["frame"])
    assert empty.tolist() == [bool(n) for n in frames]


def test_json_lines(tmp_path):
    path = tmp_path / "labels.jsonl"
    path.write_text('{"t": "007", "p": {"x": 1}, "q": [1, 0]}\n\n{"t": 8, "p": {"x": 2.5}}\n')
    table = read_label_file(path, ["t"])
    assert table[["t", "p.x", "q.0"]].fillna(-1).to_numpy().tolist() == [
        ["007", 1, 1],
        ["8", 2.5, -1],
    ]
    for text, message in (("[1]", "line 1: expected an object"), ("{", "line 1: not JSON")):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_label_file(path, [])


def test_quaternions_in_another_order_tilt_the_boxes():
    mapping = parse_yaml(propose_mapping(LABELS / "quaternions.csv"))
    mapping["columns"]["quaternion"] = dict(zip("wxyz", ["qx", "qy", "qz", "qw"], strict=True))
    with pytest.raises(InputError, match="% are tilted by more than 30 degrees, the first is row"):
        read_label_table(
            LABELS / "quaternions.csv", TableMapping.model_validate(mapping), Counter()
        )


def test_vectors_need_both_components_along_the_ground():
    """In the axes of a camera y is down, and z is ahead."""
    guess = parse_yaml(propose_mapping(LABELS / "quaternions.csv"))
    guess["axes"] = {"x": "right", "y": "down", "z": "forward"}
    guess["yaw"] = {"zero": "z"}
    columns = {key: name for key, name in guess["columns"].items() if key != "quaternion"}
    directed = columns | {"direction": {"x": "qx", "y": "qy"}}
    poses = {"x": "qx", "y": "qy", "yaw": "qz"}
    for key, changed in (
        ("columns.direction.z", guess | {"columns": directed}),
        ("poses.z", guess | {"poses": poses}),
    ):
        with pytest.raises(ValidationError, match=f"{key}: expected a column: z is not upright"):
            TableMapping.model_validate(changed)


def test_rows_in_messages_are_those_of_the_file(tmp_path):
    """After an empty frame of a folder, and after an empty row of a table."""
    frames = {n: json.loads((LABELS / "labelcloud/000.json").read_text()) for n in "789"}
    frames["7"]["objects"] = []
    frames["9"]["objects"].append(
        frames["9"]["objects"][0] | {"dimensions": dict.fromkeys(SIZE, -1.0)}
    )
    for name, content in frames.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    mapping = parse_yaml(propose_mapping(LABELS / "labelcloud")) | {"yaw": {}}
    with pytest.raises(InputError, match=rf"^{tmp_path}: 9.json: row 1: dimensions.length: "):
        read_label_table(tmp_path, TableMapping.model_validate(mapping), Counter())
    table = pd.read_csv(LABELS / "quaternions.csv")
    columns = parse_yaml(propose_mapping(LABELS / "quaternions.csv"))
    size, stamp = columns["columns"]["length"], columns["columns"]["time"]
    table.loc[1, [name for name in table if name != stamp]] = np.nan
    table.loc[3, size] = -1.0
    table.to_csv(tmp_path / "labels.csv", index=False)
    with pytest.raises(InputError, match=rf"labels.csv: row 3: {size}: "):
        read_label_table(tmp_path / "labels.csv", TableMapping.model_validate(columns), Counter())


def test_files_of_one_frame_and_folders_without_a_drive(tmp_path):
    content = (LABELS / "labelcloud/000.json").read_text()
    for name in ("left_7.json", "right_7.json"):
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=r"right_7.json: frame 7 is left_7.json, too"):
        read_label_file(tmp_path, [])
    for drive in ("a", "b"):
        (tmp_path / "two" / drive).mkdir(parents=True)
        (tmp_path / "two" / drive / "7.json").write_text(content)
    mapping = parse_yaml(propose_mapping(tmp_path / "two")) | {"yaw": {}, "drives": {}}
    read_label_table(tmp_path / "two", TableMapping.model_validate(mapping), Counter())
    mapping["columns"].pop("drive")
    with pytest.raises(
        InputError, match="2 folders of frames, but no drive; write `drive: folder`"
    ):
        read_label_table(tmp_path / "two", TableMapping.model_validate(mapping), Counter())
