"""Frames as plain tables and arrays, ego frame; see `scenes.layouts`."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray


def names_of(frames: pd.DataFrame) -> pd.Series:
    """The frames' numbers."""
    return frames["frame"].map("{:06d}".format)


def path_of(frame: Any) -> str:
    """The file of a frame's cloud."""
    return f"clouds/{frame.frame:06d}.bin"


def write_sweep(path: Path, points: NDArray[np.float32]) -> None:
    """Write points, shape (n, 4)."""
    points.astype("<f4", copy=False).tofile(path)


def write_tables(folder: Path, frames: pd.DataFrame, boxes: pd.DataFrame) -> None:
    """Write `frames.parquet` and `boxes.parquet`."""
    frames.to_parquet(folder / "frames.parquet", index=False)
    boxes.to_parquet(folder / "boxes.parquet", index=False)
