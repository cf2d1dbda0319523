"""A first guess of a mapping: what it finds, what it leaves open, that it overwrites nothing."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.configuration.yaml import parse_yaml
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS
from lidarplace.scenes.label_tables.propose import guess_columns, propose_mapping
from tests.lidarplace.company_table import Manner, mapping_of, traffic, write_in_manner
from tests.lidarplace.test_label_tables import convert


@settings(max_examples=15)
@given(
    position=st.sampled_from(["m", "cm", "mm"]),
    size=st.sampled_from(["m", "cm", "mm"]),
    angle=st.sampled_from(["rad", "deg"]),
    time=st.sampled_from(["s", "ms", "us", "ns"]),
    anchor=st.sampled_from(["centre", "bottom"]),
    seed=st.integers(0, 1000),
)
def test_units_are_guessed(tmp_path_factory, position, size, angle, time, anchor, seed):
    log = traffic(seed)
    origin = (0.0, 0.0, 0.33 if anchor == "centre" else 0.0)
    manner = Manner(position, size, angle, time, anchor, origin=origin)
    path = tmp_path_factory.mktemp("labels") / "labels.csv"
    write_in_manner(log, manner).to_csv(path, index=False)
    guess = parse_yaml(propose_mapping(path))
    wanted = mapping_of(log, manner)
    for key in ("columns", "units", "anchor", "classes", "drives"):
        assert guess[key] == wanted[key]
    assert guess["origin"]["z"] == pytest.approx(origin[2], abs=0.006)
    assert guess["frames"] == {"rate_hz": 10.0}


def standing(vehicles):
    """A frame of vehicles, each x, y, length and yaw."""
    x, y, length, yaw = np.array(vehicles).T
    table = pd.DataFrame({"x": x, "y": y, "z": 0.75, "length": length, "width": 1.9, "yaw": yaw})
    table = table.assign(height=1.5, scene="s", frame=0, timestamp_s=0.0)
    table["object_id"], table["class"] = table.index.astype(str), "Car"
    frames = pd.DataFrame({"scene": "s", "frame": [0], "timestamp_s": 0.0, "route": 0})
    return BoxLog(table[list(BOX_COLUMNS)], frames.assign(split="train"))


QUEUE = [(8.0 * n + 6.0, -3.0, 4.5 if n % 2 else 9.0, 0.0) for n in range(14)]
PARKED = [(2.2 * n + 6.0, 8.0, 4.5, np.pi / 2 * (-1) ** n) for n in range(14)]


@pytest.mark.parametrize(
    ("anchor", "vehicles", "expected"),
    [
        ("front right", QUEUE + PARKED, "front right"),
        ("rear left bottom", QUEUE + PARKED, "rear left bottom"),
        ("rear", QUEUE, "rear or rear left"),
        ("centre", QUEUE + PARKED, "centre"),
    ],
)
def test_anchors_at_which_vehicles_overlap_are_not_proposed(tmp_path, anchor, vehicles, expected):
    table = write_in_manner(standing(vehicles), Manner(anchor=anchor, origin=(0.0, 0.0, 0.0)))
    table.to_csv(tmp_path / "labels.csv", index=False)
    guess = propose_mapping(tmp_path / "labels.csv")
    assert parse_yaml(guess)["anchor"] == expected
    if " or " in expected:
        (tmp_path / "map.yaml").write_text(guess)
        page = tmp_path / "page.html"
        result = convert(
            tmp_path / "labels.csv", "--mapping", tmp_path / "map.yaml", "--preview", page, code=2
        )
        assert result.stderr.startswith("anchor: rear and rear left fit the values; expected one")
        assert "Choose one of rear and rear left" in page.read_text()


@pytest.mark.parametrize("anchor", ["bottom", "top", "centre"])
def test_an_anchor_is_at_the_height_that_varies_least(tmp_path, anchor):
    """Where the file's origin is at a LiDAR, 1.8 m above the ground."""
    manner = Manner(anchor=anchor, origin=(0.0, 0.0, 1.8))
    write_in_manner(traffic(), manner).to_csv(tmp_path / "labels.csv", index=False)
    guess = parse_yaml(propose_mapping(tmp_path / "labels.csv"))
    assert (guess["anchor"], guess["origin"]["z"]) == (anchor, pytest.approx(1.8, abs=0.006))


def test_world_and_poses_are_guessed(tmp_path):
    table = write_in_manner(traffic(drives=9), Manner(coordinates="world"))
    table.to_parquet(tmp_path / "labels.parquet")
    guess = parse_yaml(propose_mapping(tmp_path / "labels.parquet"))
    assert guess["coordinates"] == "world"
    named = {"x": "host_x", "y": "host_y", "yaw": "host_heading"}
    assert guess["poses"] == named | {"position": "m", "angle": "deg"}


@pytest.mark.parametrize("ends", ["_x _y _z _w", ".w .x .y .z", ".0 .1 .2 .3"])
@pytest.mark.parametrize("name", ["rotation", "orientation", "heading"])
def test_parts_of_a_quaternion_are_no_yaw(tmp_path, name, ends):
    """Neither of boxes nor of the vehicle, although `rotation_z` alone is one."""
    table = write_in_manner(traffic(1), Manner(heading="quaternion", coordinates="world"))
    order = "xyzw" if ends.startswith("_x") else "wxyz"
    expected = {}
    for of, new in (("heading", name), ("host_heading", f"ego_{name}")):
        columns = {
            f"{of}_q{axis}": f"{new}{end}" for axis, end in zip(order, ends.split(), strict=True)
        }
        parts = table[[*columns]].rename(columns=columns)
        table = table.drop(columns=[*columns]).join(parts)
        expected[of] = {axis: columns[f"{of}_q{axis}"] for axis in order}
    table.to_csv(tmp_path / "labels.csv", index=False)
    guess = parse_yaml(propose_mapping(tmp_path / "labels.csv"))
    assert guess["columns"]["quaternion"] == expected["heading"]
    assert guess["poses"]["quaternion"] == expected["host_heading"]
    assert "yaw" not in guess["columns"] | guess["poses"]


@pytest.mark.parametrize(
    "names",
    [
        "frame track_id class x y z length width height yaw",
        "sequence timestamp_ns track_uuid category tx_m ty_m tz_m length_m width_m height_m yaw",
        "RecordingId TimeStamp ObjectId ObjectClass CenterX CenterY CenterZ Length Width Height "
        "Heading",
        "clip t id label box_x box_y box_z l w h theta",
        "run frame_number instance type position.x position.y position.z size.l size.w size.h "
        "rotation_z",
        "session epoch obj_id kind loc_x loc_y loc_z dim_l_mm dim_w_mm dim_h_mm yaw_deg",
        "Fahrt Zeitstempel Objekt_ID Klasse PosX PosY PosZ Länge Breite Höhe Gierwinkel",
        "messfahrt zeit_us objektnummer objektklasse x_m y_m z_m laenge_m breite_m hoehe_m kurs",
        "Aufnahme Bildnummer Spur Kategorie Mitte_X Mitte_Y Mitte_Z ObjektLaenge ObjektBreite "
        "ObjektHoehe Drehwinkel",
        "trajet horodatage objet_id classe x y z longueur largeur hauteur lacet",
        "enregistrement temps_ms id_objet catégorie pos_x pos_y pos_z Longueur_m Largeur_m "
        "Hauteur_m cap_deg",
    ],
)
def test_usual_names(names):
    """In the order of the keys, however the columns stand."""
    listed = names.split()
    keys = [*mapping_of(traffic(), Manner())["columns"]]
    if listed[0] == "frame":
        keys = ["frame", *keys[2:]]
    elif listed[1].startswith(("frame", "Bild")):
        keys[1] = "frame"
    noise = ["speed", "score", "num_points", "occlusion"]
    wanted = dict(zip(keys, listed, strict=True)) | {"points": "num_points"}
    for order in (1, -1):
        assert guess_columns([*noise, *listed][::order]) == wanted


def test_classes_are_guessed_where_the_name_says_so(tmp_path):
    named = {
        "Car": "Car car passenger_car police-car PassengerCar taxi vehicle.car",
        "Cyclist": "bicycle BICYCLIST motorcycle cargo_bike rider_of_bicycle",
        "Pedestrian": "pedestrian Person person_sitting human.pedestrian.adult",
        None: "truck bus moped cart personal_mobility bike_rack scooter animal no 1 #",
    }
    wanted = {name: known for known, names in named.items() for name in names.split()}
    wanted["a: b"] = None  # as the last three YAML would take for something else
    table = pd.DataFrame({"class": list(wanted), "x": 1.0})
    table.to_csv(tmp_path / "labels.csv", index=False)
    assert parse_yaml(propose_mapping(tmp_path / "labels.csv"))["classes"] == wanted


GERMAN, FRENCH = "Fahrzeug_X Fahrzeug_Y Fahrzeug_Gierwinkel", "véhicule_x véhicule_y véhicule_cap"


@pytest.mark.parametrize("names", [GERMAN, "ego_x ego_y ego_kurs", FRENCH])
def test_names_of_poses(names):
    keys = ["poses.x", "poses.y", "poses.yaw"]
    found = guess_columns(["x", "y", "Gierwinkel", *names.split()])
    assert [found[key] for key in keys] == names.split()
    assert [found[key] for key in ("x", "y", "yaw")] == ["x", "y", "Gierwinkel"]


@pytest.mark.parametrize(("separator", "decimal"), [(";", ","), (";", "."), ("\t", ",")])
def test_separators_and_decimal_commas(tmp_path, separator, decimal):
    """The guess of such a file converts it."""
    labels, guess = tmp_path / "labels.csv", tmp_path / "guess.yaml"
    log = traffic()
    table = write_in_manner(log, Manner(origin=(0.0, 0.0, 0.33)))
    table.to_csv(labels, index=False, sep=separator, decimal=decimal)
    convert(labels, "--propose", guess)
    convert(labels, tmp_path / "log", "--mapping", guess)
    boxes = pd.read_parquet(tmp_path / "log/boxes.parquet")
    np.testing.assert_allclose(boxes[["x", "y"]], log.boxes[["x", "y"]])


def test_a_guess_is_not_overwritten(tmp_path):
    labels, guess = tmp_path / "labels.csv", tmp_path / "guess.yaml"
    write_in_manner(traffic(), Manner(origin=(0.0, 0.0, 0.33))).to_csv(labels, index=False)
    assert convert(labels, "--propose", guess).stdout == f"{guess}\n"
    assert guess.read_text().startswith("# A guess from names and values of labels.csv: check")
    before = guess.read_text()
    result = convert(labels, "--propose", guess, code=2)
    assert f"{guess}: exists, and is not overwritten" in result.stderr
    assert guess.read_text() == before


def test_what_nothing_tells_is_left_open(tmp_path):
    labels, guess = tmp_path / "labels.csv", tmp_path / "guess.yaml"
    table = write_in_manner(traffic(), Manner()).rename(columns={"posX": "A: b", "kind": "no"})
    table["no"] = table["no"].map({"person": 1, "passenger_car": 2, "bicyclist": 3})
    table.to_csv(labels, index=False)
    convert(labels, "--propose", guess)
    assert (
        '  x:   # write the name of a column here; other columns: "no, A: b"\n' in guess.read_text()
    )
    result = convert(labels, tmp_path / "log", "--mapping", guess, code=2)
    assert "guess.yaml: columns.category: expected a column, found no name" in result.stderr


@pytest.mark.parametrize("column", ["recording", "kind", "track", "posX", "stamp", "host_heading"])
def test_missing_cells_are_no_reason_to_stop(tmp_path, column):
    table = write_in_manner(traffic(), Manner(coordinates="world"))
    table[column] = table[column].where(table.index != 7)
    table.to_csv(tmp_path / "labels.csv", index=False)
    assert parse_yaml(propose_mapping(tmp_path / "labels.csv"))["columns"]


def test_tables_without_numbers(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text("x,yaw\nleft,\n")
    guess = parse_yaml(propose_mapping(path))
    assert guess["columns"]["x"] == "x"
    assert guess["units"]["position"] == "m"
    assert np.isfinite(guess["origin"]["z"])
