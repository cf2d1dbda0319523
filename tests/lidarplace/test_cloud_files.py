"""Point clouds of every format that drivers and data sets write."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarplace.clouds.cloud_files import CLOUD_SUFFIXES, decompress_lzf, read_cloud
from tests.refused import refused

_ROWS = [(1.5, 0.5, 0.0, 0.25, 0), (-2.25, 3.0, 1.75, 1.0, 31), (40.0, -1.0, 2.0, 0.0, 7)]
CLOUD = pd.DataFrame(_ROWS, columns=["x", "y", "z", "intensity", "ring"])
CLOUD = CLOUD.astype(dict.fromkeys(("x", "y", "z", "intensity"), np.float32))


def pcd(cloud, coding):
    """As the Point Cloud Library writes it, padding and all."""
    kind = np.dtype(
        [(name, "<f4") for name in ("x", "y", "z")]
        + [("_", "V4"), ("intensity", "<f4"), ("ring", "<u2")]
    )
    head = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        "FIELDS x y z _ intensity ring\nSIZE 4 4 4 1 4 2\nTYPE F F F U F U\nCOUNT 1 1 1 4 1 1\n"
        f"WIDTH {len(cloud)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(cloud)}\n"
        f"DATA {coding}\n"
    ).encode()
    if coding == "ascii":
        lines = (f"{x} {y} {z} 0 0 0 0 {i} {int(r)}\n" for x, y, z, i, r in cloud.to_numpy())
        return head + "".join(lines).encode()
    records = np.zeros(len(cloud), kind)
    for name in cloud.columns:
        records[name] = cloud[name]
    if coding == "binary_compressed":  # of each field all points; as LZF of runs as they are
        data = b"".join(records[name].tobytes() for name in kind.names)
        runs = [data[i : i + 32] for i in range(0, len(data), 32)]
        packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
        return head + np.array([len(packed), len(data)], "<u4").tobytes() + packed
    return head + records.tobytes()


def write(folder, suffix, cloud=CLOUD):
    path = folder / f"sweep{suffix}"
    values = cloud.to_numpy(np.float32)
    if suffix == ".bin":
        values[:, :4].tofile(path)
    elif suffix == ".pcd.bin":
        values.tofile(path)
    elif suffix == ".npy":
        np.save(path, values)
    elif suffix == ".feather":
        cloud.to_feather(path)
    elif suffix == ".parquet":
        cloud.to_parquet(path)
    elif suffix == ".pkl.gz":
        cloud.to_pickle(path)
    else:
        path.write_bytes(pcd(cloud, "binary"))
    return path


@pytest.mark.parametrize("suffix", [*CLOUD_SUFFIXES, "ascii", "binary_compressed"])
def test_every_format_holds_the_same_points(tmp_path, suffix):
    path = tmp_path / "a.pcd"
    if suffix in CLOUD_SUFFIXES:
        path = write(tmp_path, suffix)
    else:
        path.write_bytes(pcd(CLOUD, suffix))
    read = read_cloud(path)
    expected = CLOUD if suffix != ".bin" else CLOUD.drop(columns="ring")
    pd.testing.assert_frame_equal(read, expected, check_dtype=False)


def test_runs_that_are_there_already():
    """By hand, as LZF's format says: "abc", then six and eleven bytes from three back."""
    data = np.frombuffer(b"\x02abc\x80\x02\xe0\x02\x02", np.uint8)
    assert decompress_lzf(data, 20).tobytes() == b"abcabcabcabcabcabcab"
    for wrong, size in ((data, 19), (data[:-1], 20), (data[4:], 20), (data[:3], 3)):
        with refused("damaged compressed data"):
            decompress_lzf(wrong, size)


def test_names_of_other_makers_are_understood(tmp_path):
    """As Ouster's: columns that may mean the same, nanoseconds, and what is not needed."""
    cloud = CLOUD.rename(columns={"ring": "Channel"})
    cloud = cloud.assign(reflectivity=0.9, t=np.uint32([5, 0, 10**8]), ambient=1, range=2.0)
    cloud.to_parquet(path := tmp_path / "a.parquet")
    read = read_cloud(path)
    pd.testing.assert_frame_equal(read[list(CLOUD.columns)], CLOUD, check_dtype=False)
    np.testing.assert_allclose(read["time"], [5e-9, 0.0, 0.1])
    assert list(read.columns) == [*CLOUD.columns, "time"]


@pytest.mark.parametrize(
    ("column", "values", "row"),
    [
        *((column, [None, "2", "x"], 1) for column in ("x", "intensity", "time", "ring")),
        *(("laser_number", ["1", "2", "3"], 0), ("x", [1.0, np.inf, 2.0], 1)),
        *(("lidar", [[0], [0], [1]], 0), ("lidar", [1.0, np.nan, 0.0], 1)),
        *(("lidar", ["top", None, "top"], 1), ("time", [0.0, 0.1, -np.inf], 2)),
    ],
)
def test_a_wrong_value_is_named(tmp_path, column, values, row):
    CLOUD.drop(columns=column, errors="ignore").assign(**{column: values}).to_parquet(
        path := tmp_path / "a.parquet"
    )
    with refused((f"a.parquet: row {row}", column, "")):
        read_cloud(path)


def test_argoverse_numbers_its_lasers_through_two_lidars(tmp_path):
    sweep = pd.DataFrame({"x": np.float16([1, 2]), "y": np.float16(0), "z": np.float16(0)})
    sweep = sweep.assign(
        intensity=np.uint8([51, 255]), laser_number=np.uint8([5, 37]), offset_ns=[0, 10**8]
    )
    sweep.to_feather(path := tmp_path / "315.feather")
    read = read_cloud(path)
    assert read[["ring", "lidar"]].to_numpy().tolist() == [[5, 0], [5, 1]]
    np.testing.assert_allclose(read["intensity"], [0.2, 1.0], rtol=1e-6)
    np.testing.assert_allclose(read["time"], [0.0, 0.1])
    assert read["x"].dtype == np.float32


@given(data=st.binary(max_size=200), suffix=st.sampled_from(CLOUD_SUFFIXES))
def test_what_is_no_cloud_is_an_error_of_one_line(tmp_path_factory, data, suffix):
    path = tmp_path_factory.mktemp("c") / f"a{suffix}"
    path.write_bytes(data)
    said = str(path)
    try:
        assert {"x", "y", "z"} <= set(read_cloud(path).columns)
    except ValueError as error:
        said = str(error)
    assert str(path) in said
    assert "\n" not in said


def test_a_file_that_is_not_there_or_lacks_a_column_is_named(tmp_path):
    with refused(("b.parquet", "z", "")):
        CLOUD.drop(columns="z").to_parquet(tmp_path / "b.parquet")
        read_cloud(tmp_path / "b.parquet")
