"""Labels and files in KITTI's layout, read by code that is not the exporter's."""

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.clouds.clouds import PointClouds
from lidarplace.scenes.kitti.labels import NEAR_M, in_image, label_lines, to_labels
from lidarplace.scenes.kitti.write import NOTHING, black_png, write_kitti
from tests.lidarplace.kitti_reader import read_frame
from tests.refused import refused

CROP = (-50.0, -50.0, -0.5, 50.0, 50.0, 5.0)


def objects(*rows: tuple, frame: int = 0) -> pd.DataFrame:
    """Rows of class, x, y, z, length, width, height, yaw."""
    names = ["class", "x", "y", "z", "length", "width", "height", "yaw"]
    return pd.DataFrame(rows, columns=names).assign(frame=frame, occluded=0)


def clouds(frames: list[int], points: np.ndarray | None = None) -> PointClouds:
    cloud = np.zeros((0, 4), np.float32) if points is None else points.astype(np.float32)
    return PointClouds.from_frames(frames, [(cloud, [len(cloud)])] * len(frames), CROP)


def listed(*frames: int, split: str = "train") -> pd.DataFrame:
    return pd.DataFrame({"frame": frames, "split": split})


def export(folder: Path, boxes: pd.DataFrame, points: np.ndarray | None = None) -> None:
    write_kitti(folder, listed(0), [(to_labels(boxes), clouds([0], points))])


def test_a_car_straight_ahead_has_the_label_computed_by_hand() -> None:
    car = objects(("Car", 10.27, 0.0, 0.75, 4.0, 1.6, 1.5, 0.0))
    # The near face is 8 m ahead: 721.54 * 0.8 / 8 = 72.15 px to both sides of 609.56, its bottom
    # 721.54 * 1.65 / 8 below 172.85; the top, 0.15 m below the camera, is highest at 12 m.
    name, truncated, occluded, *numbers = label_lines(to_labels(car))[0].split(" ")
    assert (name, truncated, occluded) == ("Car", "0.00", "0")
    assert numbers[5:] == ["1.50", "1.60", "4.00", "0.00", "1.65", "10.00", "-1.57"]
    expected = [-1.57, 537.41, 181.87, 681.71, 321.67]
    # -1.57 is not quite a quarter turn: that moves a corner by 1.6 mm.
    np.testing.assert_allclose([float(text) for text in numbers[:5]], expected, atol=0.16)


def test_rotation_is_within_pi_and_alpha_is_seen_from_the_camera() -> None:
    turns = [0.0, np.pi / 2, -np.pi / 2, np.pi, -3.0, 7.0]
    labels = to_labels(objects(*(("Car", 10.27, -10.0, 0.75, 4.0, 1.6, 1.5, yaw) for yaw in turns)))
    assert labels["rotation_y"].tolist() == [-1.57, -3.14, 0.0, 1.57, 1.43, -2.29]
    # The objects are 45 degrees to the right.
    turned = labels["rotation_y"] - np.pi / 4 - labels["alpha"]
    assert (np.abs(np.sin(turned / 2)) < 0.005).all()
    assert (labels["alpha"].abs() <= 3.14).all()
    line = label_lines(to_labels(objects(("Car", 0.27, 0.001, 0.75, 4.0, 1.6, 1.5, -1.5718))))[0]
    assert "-0.00" not in line


def test_points_in_labels_are_those_in_boxes(tmp_path) -> None:
    rng = np.random.default_rng(3)
    boxes = objects(
        ("Car", 12.0, 3.0, 0.8, 4.4, 1.8, 1.6, 0.4),
        ("Cyclist", 20.0, -6.0, 1.6, 6.5, 2.5, 3.2, -2.2),
        ("Pedestrian", 7.0, 1.0, 0.9, 0.6, 0.6, 1.8, 1.0),
        ("Car", 31.0, 14.0, 0.7, 4.0, 1.7, 1.4, 3.1),
    )
    points, counts = [], []
    for box in boxes.itertuples():
        # Some inside and some outside, none nearer to a face than labels and clouds round.
        share = rng.uniform(-1.3, 1.3, (400, 3)) / 2
        gap = np.abs(np.abs(share) - 0.5) * [box.length, box.width, box.height]
        share = share[(gap > 0.02).all(axis=1)]
        counts.append(int((np.abs(share) < 0.5).all(axis=1).sum()))
        local = share * [box.length, box.width, box.height]
        c, s = np.cos(box.yaw), np.sin(box.yaw)
        turned = local @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        points.append(turned + np.array([box.x, box.y, box.z]))
    cloud = np.c_[np.concatenate(points), rng.uniform(0, 1, sum(map(len, points)))]
    cloud[:, 2] = np.maximum(cloud[:, 2], -0.4)
    export(tmp_path / "out", boxes, cloud)
    frame = read_frame(tmp_path / "out", "000000")
    assert [item.name for item in frame.objects] == boxes["class"].tolist()
    assert [int(item.holds(frame.points).sum()) for item in frame.objects] == counts
    assert min(counts) > 50
    np.testing.assert_allclose(frame.intensity, cloud[:, 3], atol=0.002)
    for item in frame.objects:
        inside = frame.pixels(frame.points[item.holds(frame.points)])
        assert (inside >= item.image_box[:2] - 0.01).all()
        assert (inside <= item.image_box[2:] + 0.01).all()


@settings(derandomize=True, max_examples=40)
@given(
    x=st.floats(-8, 60),
    y=st.floats(-30, 30),
    z=st.floats(-1, 3),
    size=st.tuples(st.floats(0.2, 12), st.floats(0.2, 3), st.floats(0.2, 4)),
    yaw=st.floats(-4, 4),
)
def test_image_box_is_the_outline_cut_to_the_image(tmp_path_factory, x, y, z, size, yaw) -> None:
    boxes = objects(("Car", x, y, z, *size, yaw))
    folder = tmp_path_factory.mktemp("kitti") / "out"
    export(folder, boxes)
    frame = read_frame(folder, "000000")
    item = frame.objects[0]
    whole = frame.outline(item, NEAR_M)
    cut = np.round(np.clip(whole, 0, [1241, 374, 1241, 374]), 2)
    if (cut[2:] <= cut[:2]).any():
        assert item.truncated == 1.0
        np.testing.assert_array_equal(item.image_box, 0.0)
        return
    np.testing.assert_allclose(item.image_box, cut, atol=0.0101)
    share = 1 - (cut[2:] - cut[:2]).prod() / (whole[2:] - whole[:2]).prod()
    assert item.truncated == pytest.approx(share, abs=0.0101)


def test_what_the_image_does_not_show() -> None:
    # One ahead, beside, behind, one that passes the camera, and one of no size.
    places, size = ((20.0, 0.0), (5.0, 15.0), (-20.0, 0.0), (0.0, 2.5)), (4.0, 1.8, 1.6, 0.0)
    cars = [("Car", *place, 0.8, *size) for place in places]
    labels = to_labels(objects(*cars, ("Car", 20.0, 0.0, 0.8, 0.0, 0.0, 0.0, 0.0)))
    assert in_image(labels).tolist() == [True, False, False, False, False]
    assert labels["truncated"].tolist() == [0.0, 1.0, 1.0, 1.0, 1.0]
    assert to_labels(objects()).empty


def test_layout(tmp_path) -> None:
    labels = to_labels(objects(("Car", 20.0, 0.0, 0.8, 4.0, 1.8, 1.6, 0.0), frame=7))
    frames = pd.concat([listed(7, 3), listed(1_000_000, split="test")], ignore_index=True)
    out = tmp_path / "a" / "out"
    write_kitti(out, frames, [(labels, clouds([3, 7])), (labels[:0], clouds([1000000]))], True)
    files = sorted(str(path.relative_to(out)) for path in out.rglob("*.*"))
    stems = ("000003", "000007", "1000000")
    wanted = [f"ImageSets/{name}.txt" for name in ("test", "train", "trainval", "val")]
    for name, suffix in (("calib", "txt"), ("image_2", "png"), ("label_2", "txt")):
        wanted += [f"training/{name}/{stem}.{suffix}" for stem in stems]
    assert files == wanted + [f"training/velodyne/{stem}.bin" for stem in stems]
    sets = {path.stem: path.read_text().split() for path in (out / "ImageSets").iterdir()}
    train, val = [*stems[:2]], [stems[2]]
    assert sets == {"train": train, "val": val, "trainval": train + val, "test": []}
    names = [item.name for stem in stems for item in read_frame(out, stem).objects]
    assert names == ["DontCare", "Car", "DontCare"]
    assert (out / "training/label_2/000003.txt").read_text() == f"{NOTHING}\n"
    assert len(NOTHING.split()) == 15
    lines = (out / "training/calib/000003.txt").read_text().splitlines()
    names = " ".join(line.split(":")[0] for line in lines)
    assert names == "P0 P1 P2 P3 R0_rect Tr_velo_to_cam Tr_imu_to_velo"
    assert not list(tmp_path.rglob("*.part"))


def test_image_has_the_size_of_the_camera() -> None:
    image = pytest.importorskip("PIL.Image").open(io.BytesIO(black_png(1242, 375)))
    image.load()
    assert (image.size, image.mode) == ((1242, 375), "RGB")
    assert np.asarray(image).max() == 0


def test_refuses_what_cannot_be_written(tmp_path) -> None:
    nothing = to_labels(objects())
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "file").touch()
    with refused((str(tmp_path / "there"), "", "")):
        write_kitti(tmp_path / "there", listed(0), [])
    for frames, parts in (
        (listed(0, split="dev"), ("", "split", "dev")),
        (listed(-1), ("", "frame", "-1")),
        (listed(0, 1), ("", "", "1")),
    ):
        with refused(parts):
            write_kitti(tmp_path / "out", frames, [(nothing, clouds([0]))])
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
