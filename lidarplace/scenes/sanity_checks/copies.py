"""Boxes and frames that are there twice: rows of a log, and test routes that repeat training."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.scenes.sanity_checks.doubt import LEAST_BOXES, Doubt

SHARE = 0.01  # of equal rows: a tool that labels may store a box twice now and then
COPIED = 0.5  # share of the frames of a test route that equal training frames
_MIX = np.uint64(0x9E3779B97F4A7C15)  # Knuth's multiplier: 2**64 over the golden ratio
LEAST_FRAMES = 3  # different ones: where nothing moves, all frames of a route are equal


def doubts_of_duplicates(log: BoxLog) -> Iterator[Doubt]:
    """Doubt of boxes that equal another one of their frame."""
    boxes = log.boxes
    frame = boxes["frame"].to_numpy(np.int64).view(np.uint64)
    equal = pd.Series(_hashes(boxes) ^ frame * _MIX).duplicated().to_numpy()
    if len(boxes) and equal.mean() > SHARE:
        why = "boxes equal another box of their frame"
        remedy = "the label file (a row a box)"
        yield Doubt("duplicates", "x", equal, why, remedy, bool(equal.sum() >= LEAST_BOXES))


def doubts_of_copies(train: BoxLog, test: BoxLog) -> Iterator[Doubt]:
    """Doubt of test frames of `test` that equal training frames of another route in `train`, which
    may be the same log."""
    trained = _frames(train)
    tested = trained if train is test else _frames(test)
    trained, tested = trained[trained["split"] == "train"], tested[tested["split"] == "test"]
    same = tested.merge(trained, on="hash", suffixes=("", "_trained"))
    if train is test:  # the paper's split divides a route, in which everything may stand still
        same = same[same["place"] != same["place_trained"]]
    if same.empty:
        return
    copied = tested["frame"].isin(same["frame"])
    share = copied.groupby(tested["place"]).transform("mean")
    different = tested["hash"].where(copied).groupby(tested["place"]).transform("nunique")
    frames = tested["frame"][copied & (share >= COPIED) & (different >= LEAST_FRAMES)]
    if len(frames):
        why = f"{len(frames):,} of {len(tested):,} test frames have all boxes of a training frame"
        rows = test.boxes["frame"].isin(frames).to_numpy()
        yield Doubt("split", "x", rows, why, "drives.test", certain=True)


def _frames(log: BoxLog) -> pd.DataFrame:
    """Frames that have boxes, by `hash` of these boxes whatever their order; `place` is the scene
    and route."""
    hashes = pd.Series(_hashes(log.boxes)).groupby(log.boxes["frame"].to_numpy()).sum()
    place = log.frames.groupby(["scene", "route"], sort=False).ngroup()
    frames = log.frames[["frame", "split"]].assign(place=place)
    return frames.merge(hashes.rename("hash"), left_on="frame", right_index=True)


def _hashes(boxes: pd.DataFrame) -> NDArray[np.uint64]:
    """A number of the geometry of each box, equal for equal boxes; (boxes,)."""
    hashes = np.zeros(len(boxes), np.uint64)
    for name in GEOMETRY:
        bits = (boxes[name].to_numpy(np.float64) + 0.0).view(np.uint64)  # one bit pattern of 0
        hashes = (hashes ^ bits) * _MIX
        hashes ^= hashes >> np.uint64(32)
    return hashes
