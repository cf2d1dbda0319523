"""Readers of TruckScenes, PandaSet, OPV2V and OpenPCDet's layout, against their development kits.

The golden numbers were printed by the data sets' own code for the folders of `small_data_sets`:
truckscenes-devkit 1.2.0 (`boxes_to_sensor` with the pose that `getclosest` finds), OpenPCDet's
`PandasetDataset._get_annotations` with pandaset's `lidar_points_to_ego`, and OpenCOOD's
`project_world_objects`, at the pose of the vehicle."""

import base64
import gzip
import json
import pickle

import numpy as np
import pandas as pd
import pytest
import yaml

from lidarplace.commands.convert import app
from lidarplace.files.pickles import read_pickle
from lidarplace.logs.box_log import read_box_log
from tests.lidarplace.small_data_sets import (
    MOUNTS,
    write_openpcdet,
    write_opv2v,
    write_pandaset,
    write_truckscenes,
)
from tests.sweeps.toy import call

BOX = ["x", "y", "z", "length", "width", "height", "yaw"]
MODELS = ("--lidar", "LIDAR_LEFT=pandar64,LIDAR_TOP_FRONT=os1_128")
PANDA = ("--lidar", "front_gt=m1", "--origin", "-0.7", "0", "2.0")


def convert(*arguments, code=0):
    return call(app, *arguments, code=code)


def test_truckscenes(tmp_path):
    """Its own trailer is no object, and its LiDARs have poses of their own times."""
    folder = write_truckscenes(tmp_path / "truckscenes" / "v1.2-mini").parent
    result = convert("truckscenes", folder, tmp_path / "log", *MODELS, "--clouds", folder)
    log = read_box_log(tmp_path / "log")
    golden = [24.489027447491434 - 1.8, 3.1408304653422827, 0.9, 4.6, 1.9, 1.7, 0.6998]
    np.testing.assert_allclose(log.boxes[BOX].to_numpy(float), [golden] * 3, atol=1e-9)
    assert "ignored: vehicle.ego_trailer      3" in result.stdout
    counts = log.boxes[["points/LIDAR_LEFT", "points/LIDAR_TOP_FRONT"]]
    assert (counts == 1).all(axis=None), "points at the centre, whenever they were measured"
    assert (log.boxes["points"] == 2).all(), "as the data set counts"
    rig = log.rigs["scene-cd-1"]
    assert rig.names == ("LIDAR_LEFT", "LIDAR_TOP_FRONT")
    assert [lidar.beams for lidar in rig.placement.lidars] == [64, 128]
    place, (yaw, pitch, _) = MOUNTS["LIDAR_TOP_FRONT"]
    front = rig.placement.mounts[1]
    np.testing.assert_allclose(front.position, np.subtract(place, (1.8, 0, 0)), atol=1e-9)
    np.testing.assert_allclose((front.yaw, front.pitch), (yaw, pitch), atol=1e-9)
    convert("truckscenes", folder, tmp_path / "log", *MODELS, "--test-share", "0.5")
    frames = read_box_log(tmp_path / "log").frames
    assert frames["split"].tolist() == ["train", "train", "test"], "a drive is not divided"
    result = convert("truckscenes", folder, tmp_path / "log", code=2)
    assert "unknown model of LIDAR_LEFT, LIDAR_TOP_FRONT; name it: --lidar" in result.stderr


def test_pandaset(tmp_path):
    """Sizes lie along y, yaw 0 too, and siblings are one object."""
    folder = write_pandaset(tmp_path / "pandaset")
    arguments = ("pandaset", folder, tmp_path / "log", *PANDA, "--test", "002")
    result = convert(*arguments, "--clouds", folder)
    log = read_box_log(tmp_path / "log")
    golden = [
        [20.50136, -1.02424, -0.67472, 4.4, 1.9, 1.6, 0.09997],
        [14.80254, -3.76722, -0.57681, 0.7, 0.6, 1.7, -1.20003],
    ]
    expected = np.add(golden, [-0.7, 0, 2.0, 0, 0, 0, 0])
    # OpenPCDet turns yaws as if the vehicle were level.
    np.testing.assert_allclose(log.boxes[BOX].to_numpy(float)[:2], expected, atol=1.5e-4)
    assert "ignored: sibling of front_gt      4" in result.stdout
    cars = log.boxes[log.boxes["class"] == "Car"]
    assert (cars[["points/main_pandar64", "points/front_gt"]] == [2, 1]).all(axis=None)
    assert log.frames["timestamp_s"].tolist() == pytest.approx([0, 0.1] * 2)
    assert log.frames["split"].tolist() == ["train"] * 2 + ["test"] * 2
    front = log.rigs["001"].placement.mounts[1]
    # As the cameras of that file lead to: 0.6 m ahead of the main LiDAR, and looking ahead.
    np.testing.assert_allclose(front.position, (-0.1, 0.02, 2.32), atol=0.01)
    assert abs(front.yaw) < 0.05
    assert abs(front.pitch) < 0.03
    assert "--origin X Y Z" in convert("pandaset", folder, tmp_path / "log", code=2).stderr


def test_opv2v(tmp_path):
    """Axes are left-handed, sizes half, and each vehicle has a rig."""
    folder = write_opv2v(tmp_path / "opv2v")
    convert("opv2v", folder, tmp_path / "log", "--clouds", folder)
    log = read_box_log(tmp_path / "log")
    golden = [
        [20.12794, -10.34876, 0.54137, 4.9, 2.12, 1.5, 3.1189],
        [22.76529, 3.22328, 0.53836, 4.98, 2.04, 1.56, -2.46787],
    ]
    mirrored = np.array(golden) * [1, -1, 1, 1, 1, 1, -1]
    np.testing.assert_allclose(log.boxes[BOX].to_numpy(float)[:2], mirrored, atol=3e-4)
    assert log.boxes["points/lidar"].tolist() == [1, 0] * 4
    assert log.frames["scene"].unique().tolist() == ["2021_train/4288", "2021_validate/4288"]
    assert log.frames["timestamp_s"].tolist() == pytest.approx([0, 0.1] * 2)
    rig = log.rigs["2021_train/4288"].placement
    (lidar,), (mount,) = rig.lidars, rig.mounts
    angles = np.degrees([lidar.elevations[0], lidar.elevations[-1]])
    np.testing.assert_allclose(angles, [-25, 2])
    assert (lidar.beams, lidar.azimuth_steps, lidar.range) == (64, 1016, 120)
    np.testing.assert_allclose(mount.position, (-0.483, -0.0087, 1.9043), atol=1e-3)
    path = folder / "train/2021_train/data_protocol.yaml"
    path.unlink()
    result = convert("opv2v", folder, tmp_path / "log", code=2)
    assert "unknown model of lidar; name it: --lidar lidar=MODEL" in result.stderr


def test_openpcdet(tmp_path):
    """Labels with tabs and blank lines, lists, and an origin at the LiDAR."""
    folder = write_openpcdet(tmp_path / "custom")
    (tmp_path / "rig.yaml").write_text("mounts: [{name: roof, z: 2.0, lidar: vlp16}]\n")
    arguments = ("openpcdet", folder, tmp_path / "log", "--clouds", folder)
    convert(*arguments, "--rig", tmp_path / "rig.yaml", "--origin", "0.5", "0", "1.0")
    log = read_box_log(tmp_path / "log")
    assert log.frames["split"].tolist() == ["train"] * 4 + ["test"] * 2
    assert log.frames["source"].tolist() == [f"{n:06d}" for n in range(6)]
    assert log.boxes["frame"].tolist() == [0, 1, 2, 3, 4], "the last one is empty"
    expected = [21.0, 3.0, 1.8, 4.5, 1.9, 1.6, 0.1]
    np.testing.assert_allclose(log.boxes[BOX].to_numpy(float), [expected] * 5)
    assert log.boxes["points/roof"].tolist() == [2] * 5
    for name in ("train", "val"):
        (folder / "ImageSets" / f"{name}.txt").unlink()
    convert("openpcdet", folder, tmp_path / "log")
    assert set(read_box_log(tmp_path / "log").frames["split"]) == {"train"}


# Mistakes


def _changed(folder, path, change):
    """Apply a change to the text of a file, or of JSON and YAML to its content."""
    file = folder / path
    if file.suffix == ".json":
        content = json.loads(file.read_text())
        file.write_text(json.dumps(change(content)))
    elif file.suffix == ".yaml":
        file.write_text(yaml.safe_dump(change(yaml.safe_load(file.read_text()))))
    elif file.name.endswith(".pkl.gz"):
        change(pd.read_pickle(file)).to_pickle(file)
    else:
        file.write_bytes(change(file.read_bytes()))


WRITERS = {
    "truckscenes": (lambda path: write_truckscenes(path / "v1.0-mini").parent, MODELS),
    "pandaset": (write_pandaset, PANDA),
    "opv2v": (write_opv2v, ()),
    "openpcdet": (write_openpcdet, ()),
}
YAML, CUBOIDS = "train/2021_train/4288/000069.yaml", "001/annotations/cuboids/00.pkl.gz"
LABELS = "labels/000001.txt"


@pytest.mark.parametrize(
    ("name", "path", "change", "message"),
    [
        ("truckscenes", "v1.0-mini/sample.json", lambda rows: [], "no boxes|not in sample.json"),
        ("truckscenes", "v1.0-mini/ego_pose.json", lambda rows: rows[3:], "not in ego_pose.json"),
        (
            *("truckscenes", "v1.0-mini/sample.json"),
            lambda rows: [row | {"timestamp": 5} for row in rows],
            "token sample-0: no pose at the time of a sample in ego_pose.json; expected one within",
        ),
        (
            *("truckscenes", "samples/LIDAR_LEFT/1692868171700000.pcd"),
            lambda data: data[:-3],
            "1692868171700000.pcd: no PCD file: ",
        ),
        (*("pandaset", CUBOIDS), lambda t: t.drop(columns="yaw"), "00.pkl.gz: yaw: missing column"),
        (
            *("pandaset", CUBOIDS),
            lambda table: table.assign(label="Spaceship"),
            "00.pkl.gz: row 0: unknown category; found 'Spaceship'; name its class",
        ),
        (
            *("pandaset", CUBOIDS),
            lambda table: table.assign(**{"position.x": np.nan}),
            "00.pkl.gz: row 0: position.x: ",
        ),
        (
            *("pandaset", "001/lidar/poses.json"),
            lambda poses: poses[:1],
            "poses.json: expected one for each of 2 files in annotations/cuboids, found 1",
        ),
        (
            *("pandaset", "001/lidar/poses.json"),
            lambda poses: [{"heading": poses[0]["heading"]}] * 2,
            "poses.json: not a valid list of poses: [0].position: ",
        ),
        (
            *("pandaset", "001/lidar/00.pkl.gz"),
            lambda table: table.assign(d=2),
            "00.pkl.gz: lidar: point of a LiDAR that is not in the rig",
        ),
        (
            *("opv2v", YAML),
            lambda frame: frame | {"lidar_pose": [1, 2, 3]},
            "000069.yaml: lidar_pose: ",
        ),
        (
            *("opv2v", YAML),
            lambda frame: {key: frame[key] for key in ("lidar_pose", "vehicles")},
            "000069.yaml: true_ego_pos: ",
        ),
        (
            *("opv2v", "train/2021_train/data_protocol.yaml"),
            lambda _: {"vehicle_base": {"sensing": {"perception": {"lidar": {"channels": 0}}}}},
            "data_protocol.yaml: channels: ",
        ),
        ("openpcdet", LABELS, lambda data: data[:-9], "000001.txt: line 1: expected 8 fields"),
        (
            *("openpcdet", LABELS),
            lambda data: data.replace(b"0.8", b"nan"),
            "000001.txt: line 1: expected finite numbers",
        ),
        (
            *("openpcdet", LABELS),
            lambda data: data.replace(b"Vehicle", b"Tank"),
            "000001.txt: line 1: unknown category; found 'Tank'",
        ),
        (
            *("openpcdet", "ImageSets/val.txt"),
            lambda data: data + b"000000\n",
            "val.txt: line 3: duplicate frame 000000",
        ),
        (
            *("openpcdet", "ImageSets/val.txt"),
            lambda data: data + b"000009\n",
            "val.txt: line 3: no file ",
        ),
        (
            *("openpcdet", "points/000001.npy"),
            lambda data: data[:-5],
            "000001.npy: no array of NumPy: ",
        ),
    ],
)
def test_one_line_for_a_mistake(tmp_path, name, path, change, message):
    write, options = WRITERS[name]
    folder = write(tmp_path / "data")
    _changed(folder, path, change)
    result = convert(name, folder, tmp_path / "log", *options, "--clouds", folder, code=2)
    assert any(part in result.stderr for part in message.split("|")), result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "log").exists()


def test_a_missing_cloud_of_one_lidar_is_an_error_and_of_all_is_counted(tmp_path):
    folder = write_truckscenes(tmp_path / "v1.0-mini").parent
    paths = sorted((folder / "samples").glob("LIDAR_*/1692868171*.pcd"))
    arguments = ("truckscenes", folder, tmp_path / "log", *MODELS, "--clouds", folder)
    paths[0].unlink()
    assert f"{paths[0]}: missing, but other files" in convert(*arguments, code=2).stderr
    paths[1].unlink()
    assert "real clouds: 2 of 3 frames have one" in convert(*arguments).stdout


class _Program:
    def __reduce__(self):
        return exec, ("raise SystemExit('a program')",)


def test_pickles_hold_tables_and_run_nothing(tmp_path):
    path = tmp_path / "a.pkl.gz"
    for content in (pickle.dumps(_Program()), pickle.dumps([1]), b"5", b""):
        path.write_bytes(gzip.compress(content))
        with pytest.raises(ValueError, match=r"a\.pkl\.gz: not pickled by pandas: "):
            read_pickle(path)
    path.write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"a\.pkl\.gz: not compressed by gzip"):
        read_pickle(path)


def test_pickles_of_the_pandas_of_2020(tmp_path):
    """Written by pandas 1.0.5, as the files of PandaSet were by that time's."""
    path = tmp_path / "a.pkl.gz"
    path.write_bytes(base64.b85decode(PANDAS_1_0))
    table = read_pickle(path)
    assert table["label"].tolist() == ["Car", "Bus"]
    assert table["yaw"].tolist() == [0.1, 0.2]
    assert table["cuboids.sensor_id"].tolist() == [-1, 0]


PANDAS_1_0 = (
    "ABzY8tW67R0{@j$UuzRV5Wh=uwYC<GShOz%AJpXKu;7D&7;Hq)!w7vZ$KKs0dw74s?w)DTfIg&J*td>?eiJ`}pQ_"
    "I6HJC_6+=si_+4;@PZ~lDnzPK&N9@8GPB4NspOUeDAWH|?O`5Dvfxs^|$`w?c)F<zLU63p(heOhQP3zjKAX9XK^s"
    "lZ&>&&v4CtNLE!JBR4t)+#XJM_l<4Qy6a}EchgRK{^D8P2(+OirlILZx>ZQp4RZZ%5=)4WK)b6N*<Sm(z1#*LX2k"
    "(!Cb;{*5nidXAXTgf=_S&oxly6a}e9cOZ0S16iwsxLpb?dzc!8g9tMNK%QHOo6ZAAhC&a<aSj00h%_*CJX~$Jmri"
    "t<uFH|YRGy#s5rd3eo2Gue86I*8IBI1%2BVv9)|0TAfYdmX%Jd|cqWA3J<bUB8gK>|m?wXQj3bbYBRC~}#`U^c^{"
    "Ec2)u4s8cIU$528cD{e3^P^Y)fA&D^n#OR2`{O^jJIDwt);I>^_CXV+N537OouBioV;!bT4#ktdxf4&Vvm4?jbw}"
    "(hdQ(5%w)JlInZ#=ESISnF7>g}&mFm>K06DL5;x0pD(Oq=l-++7n3%Iik;4?65_x-&G{$4$>3_A>B!>mQL3JNf7("
    "yzT`Sw$~>v!0J+h>y50>rs{BG#83Go~1DjBo!fWDQZQTOhh1##5>eASF{7Gbto~b<(0DY7vfyw7SrA=Hag6?W_FP"
    "dF%HujS9Jze<o^P4M<62%1ONa"
)
