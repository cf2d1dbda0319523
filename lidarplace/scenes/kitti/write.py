"""A data set in KITTI's object layout, as OpenPCDet reads it."""

import struct
import zlib
from collections.abc import Collection, Iterable
from pathlib import Path

import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Clouds
from lidarplace.files.atomic import replacing
from lidarplace.logs.boxes import first
from lidarplace.scenes.kitti.calibration import IMAGE_SIZE, calibration_text
from lidarplace.scenes.kitti.labels import label_lines
from lidarplace.scenes.kitti.read import SETS, frame_name
from lidarplace.scenes.kitti.velodyne import write_cloud

NOTHING = "DontCare -1 -1 -10 0.00 0.00 0.00 0.00 -1 -1 -1 -1000 -1000 -1000 -10"
"""The line of a frame without objects, which OpenPCDet needs: a region of no size."""


def check_new(folder: Path) -> None:
    """Raise ValueError if `folder` holds anything, which would mix with what is written."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError("exists", place=folder, fix="name a new or an empty folder")


def write_kitti(
    folder: Path,
    frames: pd.DataFrame,
    portions: Iterable[tuple[pd.DataFrame, Clouds]],
    images: bool = False,
    secret: bool = False,
) -> None:
    """Write `training/{velodyne,label_2,calib}` and `ImageSets`; the folder appears at the end.

    Split train is listed in `train.txt`, split test in `val.txt`; `test.txt`, KITTI's frames
    without labels, is empty.

    Args:
        folder: new or empty.
        frames: `frame` and `split` of all frames, a frame log.
        portions: labels (see `to_labels`) and clouds of some of the frames; together of all.
        images: write black images of the camera's size too, for tools that ask them for it.
        secret: write split test into `testing`, without labels, and list it in `test.txt`.

    Raises ValueError if the folder is not empty, a split or a frame number is not possible, or the
    portions are not of these frames."""
    check_new(folder)
    if (row := first(~frames["split"].isin(list(SETS.values())))) is not None:
        raise InputError(key="split", expected="train or test", found=frames["split"].iloc[row])
    if (frames["frame"] < 0).any():
        raise InputError(key="frame", expected="at least 0", found=frames["frame"].min())
    folder.parent.mkdir(parents=True, exist_ok=True)
    with replacing(folder) as partial:
        train, test = (frames["frame"][frames["split"] == s].tolist() for s in SETS.values())
        val, test = ([], test) if secret else (test, [])
        written = _write_frames(partial, portions, images, frozenset(test))
        if sorted(written) != sorted(frames["frame"].tolist()):
            raise InputError(expected=f"clouds of {len(frames)} frames", found=len(written))
        (partial / "ImageSets").mkdir()
        lists = {"train": train, "val": val, "test": test, "trainval": train + val}
        for name, numbers in lists.items():
            text = "".join(f"{stem}\n" for stem in sorted(map(frame_name, numbers)))
            (partial / "ImageSets" / f"{name}.txt").write_text(text)


def _write_frames(
    folder: Path,
    portions: Iterable[tuple[pd.DataFrame, Clouds]],
    images: bool,
    secret: Collection[int],
) -> list[int]:
    calibration, image = calibration_text(), black_png(*IMAGE_SIZE)
    training, testing = folder / "training", folder / "testing"
    for name in ("velodyne", "label_2", "calib", *(["image_2"] if images else [])):
        (training / name).mkdir(parents=True)
        if secret and name != "label_2":
            (testing / name).mkdir(parents=True)
    written = []
    for labels, clouds in portions:
        lines: dict[int, list[str]] = {}
        for frame, line in zip(labels["frame"].tolist(), label_lines(labels), strict=True):
            lines.setdefault(frame, []).append(line)
        for frame, points in zip(clouds.frames.tolist(), clouds, strict=True):
            stem, portion = frame_name(frame), testing if frame in secret else training
            write_cloud(portion / "velodyne" / f"{stem}.bin", points)
            if frame not in secret:
                text = "\n".join([*lines.get(frame, [NOTHING]), ""])
                (portion / "label_2" / f"{stem}.txt").write_text(text)
            (portion / "calib" / f"{stem}.txt").write_text(calibration)
            if images:
                (portion / "image_2" / f"{stem}.png").write_bytes(image)
            written.append(frame)
    return written


def black_png(width: int, height: int) -> bytes:
    """Draw a black RGB image in PNG's format, in some kilobytes (ISO/IEC 15948)."""
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    rows = zlib.compress(bytes(height * (1 + 3 * width)), 9)
    image = b"\x89PNG\r\n\x1a\n"
    for name, data in ((b"IHDR", header), (b"IDAT", rows), (b"IEND", b"")):
        check = struct.pack(">I", zlib.crc32(name + data))
        image += struct.pack(">I", len(data)) + name + data + check
    return image
