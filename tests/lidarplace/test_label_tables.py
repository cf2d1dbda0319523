"""Label files in a company's manner come back as the log that they were written from."""

import math
from collections import Counter

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.commands.convert import app
from lidarplace.logs.box_log import read_box_log
from lidarplace.logs.boxes import GEOMETRY, POSE_COLUMNS
from lidarplace.scenes.label_tables.mapping import TableMapping, read_mapping
from lidarplace.scenes.label_tables.propose import propose_mapping
from lidarplace.scenes.label_tables.read import read_label_table
from tests.docs_blocks import ROOT, blocks
from tests.lidarplace.company_table import Manner, mapping_of, traffic, write_in_manner
from tests.sweeps.toy import call


def write(folder, log, manner, change=None, **keys):
    """The label file and its mapping; `change` makes the table wrong."""
    table = write_in_manner(log, manner)
    path = folder / "labels.csv"
    (table if change is None else change(table)).to_csv(path, index=False)
    mapping = mapping_of(log, manner) | keys
    (folder / "map.yaml").write_text(yaml.safe_dump(mapping))
    return path, folder / "map.yaml"


manners = st.builds(
    Manner,
    position=st.sampled_from(["m", "cm", "mm"]),
    size=st.sampled_from(["m", "cm", "mm"]),
    angle=st.sampled_from(["rad", "deg"]),
    time=st.sampled_from(["s", "ms", "us", "ns", "iso"]),
    anchor=st.sampled_from(["centre", "bottom", "top", "rear left bottom"]),
    axes=st.sampled_from(
        [
            ("forward", "left", "up"),
            ("forward", "right", "up"),
            ("left", "back", "up"),
            ("right", "forward", "up"),
            ("forward", "right", "down"),
            ("back", "left", "up"),
        ]
    ),
    zero=st.sampled_from(["x", "y", "-y"]),
    sense=st.sampled_from([None, "clockwise", "counterclockwise"]),
    half=st.booleans(),
    heading=st.sampled_from(["yaw", "quaternion", "direction"]),
    origin_yaw=st.sampled_from([0.0, 0.7]),
    coordinates=st.sampled_from(["ego", "world"]),
    origin=st.tuples(st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 2)),
    rate_hz=st.sampled_from([None, 10.0]),
)


@settings(max_examples=20)
@given(manner=manners, seed=st.integers(0, 1000), suffix=st.sampled_from([".csv", ".parquet"]))
def test_a_log_comes_back(tmp_path_factory, manner, seed, suffix):
    log = traffic(seed, drives=2, frames=4, objects=4)
    table = write_in_manner(log, manner)
    path = tmp_path_factory.mktemp("labels") / f"labels{suffix}"
    shuffled = table.sample(frac=1, random_state=seed)
    shuffled.to_csv(path, index=False) if suffix == ".csv" else shuffled.to_parquet(path)
    mapping = TableMapping.model_validate(mapping_of(log, manner))
    read_log = read_label_table(path, mapping, Counter())
    boxes, wanted = (
        table_of_boxes.sort_values(["frame", "object_id"], ignore_index=True)
        for table_of_boxes in (read_log.boxes, log.boxes)
    )
    names, sides = ["scene", "frame", "object_id", "class"], list(GEOMETRY[:6])
    assert boxes[names].to_numpy().tolist() == wanted[names].to_numpy().tolist()
    np.testing.assert_allclose(boxes["timestamp_s"], wanted["timestamp_s"], atol=1e-6)
    np.testing.assert_allclose(boxes[sides], wanted[sides], rtol=0, atol=1e-9)
    turn = boxes["yaw"] - wanted["yaw"]
    np.testing.assert_allclose(np.remainder(turn + 1, 2 * math.pi), 1, atol=1e-9)
    names = ["scene", "frame", "route", "split"]
    assert read_log.frames[names].to_numpy().tolist() == log.frames[names].to_numpy().tolist()
    if manner.coordinates == "world":
        ego = read_log.frames[list(POSE_COLUMNS)] - log.frames[list(POSE_COLUMNS)]
        np.testing.assert_allclose(ego[["ego_x", "ego_y"]], 0, atol=1e-9)
        np.testing.assert_allclose(np.remainder(ego["ego_yaw"] + 1, 2 * math.pi), 1, atol=1e-9)


def test_poses_of_another_file_and_rate(tmp_path):
    """Poses of the first and the last time of a drive are enough where it goes straight on."""
    log = traffic(3, straight=True)
    manner = Manner(coordinates="world")
    labels, _ = write(tmp_path, log, manner)
    table = pd.read_csv(labels)
    poses = table[["recording", "stamp", "host_x", "host_y", "host_heading"]].drop_duplicates()
    ends = poses[poses["stamp"] % 10**6 % 700_000 == 0].rename(columns={"stamp": "utc"})
    assert len(ends) == 6
    ends.to_csv(tmp_path / "poses.csv", index=False)
    table.drop(columns=["host_x", "host_y", "host_heading"]).to_csv(labels, index=False)
    content = mapping_of(log, manner)
    content["poses"] = content["poses"] | {"file": "poses.csv", "stamp": "utc"}
    (tmp_path / "with_poses.yaml").write_text(yaml.safe_dump(content))
    mapping = read_mapping(tmp_path / "with_poses.yaml")  # whose folder the path is relative to
    read_log = read_label_table(labels, mapping, Counter())
    found_boxes = read_log.boxes.sort_values(["frame", "object_id"], ignore_index=True)
    np.testing.assert_allclose(found_boxes[["x", "y"]], log.boxes[["x", "y"]], atol=1e-6)
    np.testing.assert_allclose(read_log.frames["ego_x"], log.frames["ego_x"], atol=1e-6)


def test_frames_without_a_box_count_at_a_rate(tmp_path):
    log, rate = traffic(), {"rate_hz": 10}
    labels, mapping = write(
        tmp_path, log, Manner(), lambda t: t[t["stamp"] % 10**6 != 300_000], frames=rate
    )
    read_log = read_label_table(labels, read_mapping(mapping), Counter())
    assert len(read_log.frames) == len(log.frames) == 24
    assert set(read_log.frames["frame"]) - set(read_log.boxes["frame"]) == {3, 11, 19}


def test_a_clock_may_drift_and_a_frame_takes_a_while(tmp_path):
    """A frame of 101 ms at 10 Hz is a frame off after a second; its rows are 0 to 20 ms late."""
    log = traffic(drives=1, frames=80)
    late = np.random.default_rng(0).integers(0, 20_000, len(log.boxes))
    start = 1_760_000_000 * 10**6

    def drifting(table):
        return table.assign(stamp=start + (table["stamp"] - start) * 101 // 100 + late)

    keys = {"drives": {}, "frames": {"rate_hz": 10}}
    labels, mapping = write(tmp_path, log, Manner(), drifting, **keys)
    read_log = read_label_table(labels, read_mapping(mapping), Counter())
    assert read_log.boxes["frame"].tolist() == log.boxes["frame"].tolist()
    np.testing.assert_allclose(np.diff(read_log.frames["timestamp_s"]), 0.101, atol=0.0201)


def test_numbers_of_frames(tmp_path):
    log = traffic()
    log.boxes["n"] = 10 + log.boxes["frame"] % 8

    def numbered(table):
        table = table.drop(columns="stamp").assign(n=log.boxes["n"])
        return table[table["n"] != 12]

    names = columns(frame="n", time=None)
    for rate, frames, last in ((None, 21, math.nan), (5.0, 24, 1.4)):
        keys = names | {"frames": {"rate_hz": rate}}
        labels, mapping = write(tmp_path, log, Manner(), numbered, **keys)
        read_log = read_label_table(labels, read_mapping(mapping), Counter())
        assert len(read_log.frames) == frames
        np.testing.assert_allclose(read_log.frames["timestamp_s"].iloc[-1], last)


def test_what_is_refused_is_drawn(tmp_path):
    labels, mapping = write(tmp_path, traffic(), Manner(), **units(angle="rad"))
    page = tmp_path / "first.html"
    convert(labels, tmp_path / "log", "--mapping", mapping, "--preview", page, code=2)
    assert page.exists()
    assert not (tmp_path / "log").exists()


def test_categories_left_out_are_counted_and_numbers_name_too(tmp_path):
    log = traffic()
    codes = {"passenger_car": 1, "bicyclist": 2, "person": 3}
    classes = {1: "Car", 2: None, 3: "Pedestrian"}
    labels, mapping = write(
        tmp_path, log, Manner(), lambda t: t.assign(kind=t["kind"].map(codes)), classes=classes
    )
    ignored = Counter()
    read_log = read_label_table(labels, read_mapping(mapping), ignored)
    assert ignored == {"2": (log.boxes["class"] == "Cyclist").sum()}
    assert set(read_log.boxes["class"]) == {"Car", "Pedestrian"}


def convert(*arguments, code=0):
    return call(app, "table", *arguments, code=code)


@pytest.mark.parametrize("coordinates", ["ego", "world"])
def test_the_command(tmp_path, coordinates):
    labels, mapping = write(tmp_path, traffic(), Manner(coordinates=coordinates))
    page = tmp_path / "first.html"
    convert(labels, "--mapping", mapping, "--preview", page)
    text = page.read_text()
    assert "drive 0, frame 5, t = 0.5 s" in text
    assert "Car: 48 boxes, 4.40 × 1.80 × 1.50 m in the median." in text
    assert sorted(p.name for p in tmp_path.iterdir()) == ["first.html", "labels.csv", "map.yaml"]
    convert(labels, tmp_path / "log", "--mapping", mapping)
    assert len(read_box_log(tmp_path / "log").boxes) == 144


def units(**changed):
    return {"units": {"position": "m", "size": "mm", "angle": "deg", "time": "us"} | changed}


def columns(**changed):
    return {"columns": mapping_of(traffic(), Manner())["columns"] | changed}


def cell(column, value):
    def change(table):
        table = table.astype({column: object})
        table.loc[5, column] = value
        return table

    return change


MISTAKES = {
    "an object twice": ({}, lambda t: pd.concat([t, t[:3]]), "the first is row 144 with '0-0' of"),
    "negative": ({}, cell("wid", -1800), "row 5: wid: "),
    "no row": ({}, lambda t: t[:0], "no rows"),
    "radians as degrees": (
        {},
        lambda t: t.assign(heading=np.linspace(-math.pi, math.pi, len(t))),
        "column heading: yaw ends at 3.14 degrees, where radians end: 144 of 144 boxes",
    ),
    "the own vehicle": (
        {},
        lambda t: t.assign(**{k: t[k].where(t["track"] != "0-0", 0.5) for k in ("posX", "posY")}),
        "the centre is in the body of the vehicle: 8 of 144 boxes (5.6 %)",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line_and_nothing_is_written(tmp_path, name):
    keys, change, message = MISTAKES[name]
    labels, mapping = write(tmp_path, traffic(), Manner(), change, **keys)
    result = convert(labels, tmp_path / "log", "--mapping", mapping, code=2)
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert str(tmp_path) in result.stderr
    assert not (tmp_path / "log").exists()


def test_a_yaw_of_endless_turns_is_refused_in_the_world(tmp_path):
    manner = Manner(coordinates="world")
    labels, mapping = write(tmp_path, traffic(1), manner, cell("heading", 1e308))
    result = convert(labels, tmp_path / "log", "--mapping", mapping, code=2)
    assert "column heading: yaw is in radians; over two turns: 1 of 144 boxes" in result.stderr


ANOTHER_WAY = "column host_heading: the vehicle drives another way than it heads"
POSES = {"x": "host_x", "y": "host_y", "yaw": "host_heading"}


@pytest.mark.parametrize(
    ("angle", "change", "message"),
    [
        ("rad", None, "labels.csv: host_heading: 100.0 % of the rows are over two turns"),
        ("deg", lambda t: t.assign(host_heading=90 - t["host_heading"]), ANOTHER_WAY),
        ("deg", lambda t: t.assign(host_heading=np.radians(t["host_heading"])), ANOTHER_WAY),
        ("deg", lambda t: t.assign(host_heading=180 + t["host_heading"]), ANOTHER_WAY),
    ],
    ids=["degrees as radians", "compass", "radians as degrees", "backwards"],
)
def test_a_wrong_heading_of_the_vehicle_is_refused_unless_accepted(
    tmp_path, angle, change, message
):
    poses = {"poses": POSES | {"angle": angle}}
    manner = Manner(coordinates="world")
    labels, mapping = write(tmp_path, traffic(1), manner, change, **poses)
    result = convert(labels, tmp_path / "log", "--mapping", mapping, code=2)
    assert message in result.stderr
    assert "change poses." in result.stderr
    assert result.stderr.count("\n") == 1
    every = ["poses", "yaw", "place", "size", "ground", "time"]
    labels, mapping = write(tmp_path, traffic(1), manner, change, **poses, accept=every)
    convert(labels, tmp_path / "log", "--mapping", mapping)


def test_what_is_meant_is_accepted(tmp_path):
    """Long cars where they are; 0.0548 radians are 3.14 degrees, implausible of degrees alone."""

    def long(table):
        return table.assign(len=table["len"].where(table["kind"] != "passenger_car", 60_000))

    def turned(table):
        return table.assign(heading=table["heading"] * 0.0548 / table["heading"].abs().max())

    for log, manner, change, keys in (
        (traffic(), Manner(), long, {"accept": ["size"]}),
        (traffic(straight=True), Manner(angle="rad"), turned, {}),
    ):
        labels, mapping = write(tmp_path, log, manner, change, **keys)
        convert(labels, tmp_path / "log", "--mapping", mapping)


LABELS, MAP = "examples/labels/labels.csv", "examples/labels/map.yaml"


def printed(language, start):
    """The block of docs/label_files.md that starts so."""
    of_page = [block.text for block in blocks(language) if block.page == "label_files.md"]
    return next(text for text in of_page if text.startswith(start))


def test_the_example_is_as_the_docs_show_it(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("FORCE_COLOR", "1")  # as in a terminal, one without colours
    monkeypatch.setenv("TERM", "dumb")
    assert propose_mapping(ROOT / LABELS) == printed("yaml", "# A guess")
    result = convert(LABELS, tmp_path / "labels", "--mapping", MAP)
    assert result.stdout.replace(str(tmp_path), "logs") == printed("text", "Frames")
    content = yaml.safe_load((ROOT / MAP).read_text(encoding="utf-8"))
    content["units"]["angle"] = "rad"
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
    result = convert(LABELS, tmp_path / "log", "--mapping", tmp_path / "map.yaml", code=2)
    assert result.stderr == printed("text", "examples/labels")
