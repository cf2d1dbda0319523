"""Point clouds as drivers and data sets write them: a file a sweep, of whatever format."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyarrow import feather

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import njit
from lidarplace.files.atomic import first_line, reading
from lidarplace.files.columns import check_columns, groups, integers, no_text, numbers_if_known
from lidarplace.files.pickles import read_pickle
from lidarplace.files.regular import regular

COLUMNS = ("x", "y", "z", "intensity", "ring", "lidar", "time")
"""Columns of a cloud, of which the first three are in every cloud.

Units: metres, intensity in [0, 1], number of the laser from 0, LiDAR by number or name, and seconds
from the first point."""
NAMES: Mapping[str, str] = {
    **{name: name for name in COLUMNS},
    **dict.fromkeys(("i", "reflectivity", "reflectance", "remission"), "intensity"),
    **dict.fromkeys(("channel", "laser", "laser_id", "beam", "row"), "ring"),
    **dict.fromkeys(("lidar_id", "sensor", "sensor_id", "lidar_name"), "lidar"),
    **dict.fromkeys(("t", "timestamp", "time_s", "offset_time", "offset_ns"), "time"),
}
"""Names of the columns in files, in lower case; others are left out.

Times that are whole numbers are nanoseconds; intensities that are whole, or beyond 1, are of
255."""
ARGOVERSE_BEAMS = 32
"""Beams of each of Argoverse's two LiDARs, whose `laser_number` counts through both."""
_NUMPY = {("F", 4): "<f4", ("F", 8): "<f8"} | {
    (kind, size): f"<{kind.lower()}{size}" for kind in "IU" for size in (1, 2, 4, 8)
}


class CloudFile(NamedTuple):
    """A file of a frame's points, and where these are."""

    path: str  # relative to the folder of clouds
    to_ego: NDArray[np.float64]
    """Matrix from the file's frame to our ego frame, metres, (3, 4); it may mirror."""
    lidar: str = ""  # name of the LiDAR of all points; empty: that of column `lidar`


def read_cloud(path: Path) -> pd.DataFrame:
    """Return the points of a file, in its order and in its own frame.

    `.bin` is KITTI's (x, y, z, intensity; float32), `.pcd.bin` nuScenes' (and ring), `.pcd` that of
    the Point Cloud Library (any coding), `.pkl.gz` PandaSet's; `.feather`, `.parquet` and
    structured `.npy` have named columns, see `NAMES`; an `.npy` without names has those of
    `COLUMNS` in their order. x, y, z are float32 or float64; what a LiDAR did not see may be NaN.
    Raises ValueError, which names the file, for what cannot be read, is none of these, or has a
    wrong value."""
    with reading(path):
        for suffix, read in _READERS.items():
            if path.name.lower().endswith(suffix):
                return _in_order(read(path), str(path))
    raise InputError("unknown format of a point cloud", place=path, expected=", ".join(_READERS))


def _in_order(table: pd.DataFrame, source: str) -> pd.DataFrame:
    """Return the columns that are known, with their units."""
    column_of: dict[str, str] = {}
    table.columns = table.columns.map(str)
    # A column of the very name comes before others that may mean the same.
    for column in sorted(table.columns, key=lambda name: name.lower() not in COLUMNS):
        if (name := NAMES.get(column.lower())) is not None:
            column_of.setdefault(name, column)
    check_columns(list(table.columns), [column_of.get(name, name) for name in COLUMNS[:3]], source)
    check_columns(list(table.columns), list(column_of.values()), source)
    if "laser_number" in table.columns:
        no_text(table, ["laser_number"], source)
        laser = integers(table, "laser_number", source)
        table = table.assign(ring=laser % ARGOVERSE_BEAMS, lidar=laser // ARGOVERSE_BEAMS)
        column_of |= {"ring": "ring", "lidar": "lidar"}
    cloud = pd.DataFrame(
        {name: table[column_of[name]].to_numpy() for name in COLUMNS if name in column_of}
    )
    if "lidar" in cloud:
        cloud["lidar"] = groups(cloud, "lidar", source)
    of_numbers = list(cloud.columns.difference(["lidar"]))
    no_text(cloud, of_numbers, source)
    for name in of_numbers:
        if (kind := cloud[name].dtype.kind) not in "iu":
            values = numbers_if_known(cloud, name, source)
            cloud[name] = cloud[name] if kind == "f" else values
    cloud = cloud.astype({n: np.float32 for n in "xyz" if cloud[n].dtype != np.float64})
    if "intensity" in cloud:
        light = cloud["intensity"].to_numpy(np.float32)
        byte = cloud["intensity"].dtype.kind in "iu" or (len(light) and np.nanmax(light) > 1)
        cloud["intensity"] = np.clip(light / 255 if byte else light, 0, 1)
    if "time" in cloud and len(cloud):
        unit = 1e-9 if cloud["time"].dtype.kind in "iu" else 1.0
        cloud["time"] = (cloud["time"] - cloud["time"].min()) * unit
    return cloud


def _floats(columns: int, path: Path) -> pd.DataFrame:
    size = regular(path).stat().st_size
    if size % (4 * columns):
        expected = f"{columns} float32 a point ({', '.join(COLUMNS[:columns])})"
        raise InputError("no whole points", place=path, expected=expected, found=f"{size} bytes")
    values = np.fromfile(path, "<f4").reshape(-1, columns)
    return pd.DataFrame(values, columns=list(COLUMNS[:columns]))


def _npy(path: Path) -> pd.DataFrame:
    try:
        array = np.load(regular(path), allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise InputError(f"no array of NumPy: {first_line(error)}", place=path) from None
    if array.dtype.names:
        return pd.DataFrame({name: array[name].ravel() for name in array.dtype.names})
    if array.ndim != 2 or array.dtype.kind not in "iuf" or not 3 <= array.shape[1] <= len(COLUMNS):
        expected = f"numbers of shape (points, 3 to {len(COLUMNS)}): {', '.join(COLUMNS)}"
        found = f"{array.dtype}, shape {array.shape}"
        raise InputError("no points", place=path, expected=expected, found=found)
    return pd.DataFrame(array, columns=list(COLUMNS[: array.shape[1]]))


def _arrow(path: Path) -> pd.DataFrame:
    try:
        with regular(path).open("rb") as file:
            if path.suffix.lower() == ".parquet":
                return pd.read_parquet(file)
            return pd.DataFrame(feather.read_table(file).to_pandas(ignore_metadata=True))
    except (ValueError, KeyError) as error:  # Arrow's own are of the first
        raise InputError(f"no table: {first_line(error)}", place=path) from None


def _pandaset(path: Path) -> pd.DataFrame:
    return read_pickle(path).rename(columns={"d": "lidar"})


def _pcd(path: Path) -> pd.DataFrame:
    with regular(path).open("rb") as file:
        try:
            return _pcd_points(file, _pcd_header(file))
        except (ValueError, KeyError, IndexError) as error:
            reason = f"is missing: {error}" if isinstance(error, KeyError) else first_line(error)
            raise InputError(f"no PCD file: {reason}", place=path) from None


def _pcd_header(file: BinaryIO) -> dict[str, list[str]]:
    """Return the lines of the header by their first word, up to DATA."""
    header: dict[str, list[str]] = {}
    while "DATA" not in header:
        line = file.readline(10_000)
        if not line:
            raise ValueError("no line DATA")
        if line.strip() and not line.startswith(b"#"):
            name, *values = line.decode("ascii").split()
            header[name] = values
    return header


def _pcd_points(file: BinaryIO, header: Mapping[str, list[str]]) -> pd.DataFrame:
    """Return the points after a header; of fields with several values the first is taken."""
    names, kinds = header["FIELDS"], header["TYPE"]
    sizes = list(map(int, header["SIZE"]))
    counts = list(map(int, header.get("COUNT", ["1"] * len(names))))
    points = int(header["POINTS"][0])
    # Padding is called _, several times.
    kinds_of_fields = [
        (f"{name}{n}" if name == "_" else name, _NUMPY[kind, size], (count,))
        for n, (name, kind, size, count) in enumerate(zip(names, kinds, sizes, counts, strict=True))
    ]
    (coding,) = header["DATA"]
    if coding == "ascii":
        first = np.cumsum([0, *counts[:-1]])
        rows = np.loadtxt(file, np.float64, ndmin=2, usecols=first.tolist())
        rows = rows.reshape(-1, len(names))
        table = pd.DataFrame(rows, columns=[name for name, _, _ in kinds_of_fields])
    elif coding == "binary":
        records = np.frombuffer(file.read(), np.dtype(kinds_of_fields), points)
        table = pd.DataFrame({name: records[name][:, 0] for name, _, _ in kinds_of_fields})
    elif coding == "binary_compressed":  # each field of all points, one after the other
        packed, size = np.frombuffer(file.read(8), "<u4").tolist()
        kinds_of_all = [(name, kind, (points, *count)) for name, kind, count in kinds_of_fields]
        if size != np.dtype(kinds_of_all).itemsize:
            raise InputError(key="POINTS", expected=f"{points} points", found=f"{size} bytes")
        data = decompress_lzf(np.frombuffer(file.read(packed), np.uint8), size)
        (record,) = np.frombuffer(data.tobytes(), np.dtype(kinds_of_all))
        table = pd.DataFrame({name: record[name][:, 0] for name, _, _ in kinds_of_fields})
    else:
        allowed = "ascii, binary or binary_compressed"
        raise InputError(key="DATA", expected=allowed, found=coding)
    if len(table) != points:
        raise InputError(key="POINTS", expected=points, found=len(table))
    return table


def decompress_lzf(data: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return `size` bytes that LZF compressed, as the Point Cloud Library does.

    Raises ValueError for data that are damaged."""
    out = np.empty(size, np.uint8)
    if _lzf(data, out) != size:
        raise ValueError("damaged compressed data")
    return out


@njit(cache=True, nogil=True)
def _lzf(data: NDArray[np.uint8], out: NDArray[np.uint8]) -> int:
    """Decompress into `out`, and return the number of bytes; -1 if the data are damaged."""
    i, n = 0, 0
    while i < len(data):
        control = int(data[i])
        i += 1
        if control < 32:  # a run of bytes as they are
            length = control + 1
            if i + length > len(data) or n + length > len(out):
                return -1
            out[n : n + length] = data[i : i + length]
            i += length
        else:  # a run that is there already
            length = 2 + (control >> 5)
            if length == 9 and i < len(data):
                length += int(data[i])
                i += 1
            if i >= len(data):
                return -1
            start = n - ((control & 31) << 8) - int(data[i]) - 1
            i += 1
            if start < 0 or n + length > len(out):
                return -1
            for k in range(length):  # runs may overlap
                out[n + k] = out[start + k]
        n += length
    return n


# By the end of a file's name; the first that fits.
_READERS: dict[str, Callable[[Path], pd.DataFrame]]
_READERS = {".pcd.bin": partial(_floats, 5), ".bin": partial(_floats, 4), ".pcd": _pcd}
_READERS |= {".feather": _arrow, ".parquet": _arrow, ".npy": _npy, ".pkl.gz": _pandaset}
CLOUD_SUFFIXES = tuple(_READERS)
