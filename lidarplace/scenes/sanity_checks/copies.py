"""Duplicate boxes and frames: rows of a log, and test routes that repeat training."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.logs.plausibility import ImplausibleValue
from lidarplace.scenes.sanity_checks.boxes import LEAST_BOXES

SHARE = 0.01  # of equal rows: a tool that labels may store a box twice now and then
COPIED = 0.5  # share of the frames of a test route that equal training frames
_MIX = np.uint64(0x9E3779B97F4A7C15)  # Knuth's multiplier: 2**64 over the golden ratio
LEAST_FRAMES = 3  # different ones: where nothing moves, all frames of a route are equal


def duplicate_boxes(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Check for boxes that equal another one of their frame."""
    frame = log.boxes["frame"].to_numpy(np.int64).view(np.uint64)
    equal = pd.Series(_hashes(log.boxes) ^ frame * _MIX).duplicated().to_numpy()
    if len(equal) and equal.mean() > SHARE:
        problem, remedy = "boxes equal another box of their frame", "the label file (a row a box)"
        certain = bool(equal.sum() >= LEAST_BOXES)
        yield ImplausibleValue("duplicates", "x", problem, remedy, certain, equal)


def copied_test_frames(train: BoxLog, test: BoxLog) -> Iterator[ImplausibleValue]:
    """Check for test frames of `test` that equal training frames of another route in `train`.

    Both may be one log."""
    trained = _frames(train)
    tested = trained if train is test else _frames(test)
    trained, tested = trained[trained["split"] == "train"], tested[tested["split"] == "test"]
    same = tested.merge(trained, on="hash", suffixes=("", "_trained"))
    if train is test:  # the paper's split divides a route, in which everything may stand still
        same = same[same["place"] != same["place_trained"]]
    if same.empty:
        return
    copied = tested["frame"].isin(same["frame"])
    share = copied.groupby(tested["place"]).mean()
    different = tested[copied].groupby("place")["hash"].nunique()
    places = share.index[(share >= COPIED) & (different.reindex(share.index) >= LEAST_FRAMES)]
    frames = tested["frame"][copied & tested["place"].isin(places)]
    if len(frames):
        problem = f"{len(frames):,} of {len(tested):,} test frames have all boxes of a training "
        rows = test.boxes["frame"].isin(frames).to_numpy()
        yield ImplausibleValue("split", "x", f"{problem}frame", "drives.test", True, rows)


def _frames(log: BoxLog) -> pd.DataFrame:
    """List frames that have boxes, with a `hash` of these; `place` numbers scenes and routes."""
    hashes = pd.Series(_hashes(log.boxes)).groupby(log.boxes["frame"].to_numpy()).sum()
    place = log.frames.groupby(["scene", "route"], sort=False).ngroup()
    frames = log.frames[["frame", "split"]].assign(place=place)
    return frames.merge(hashes.rename("hash"), left_on="frame", right_index=True)


def _hashes(boxes: pd.DataFrame) -> NDArray[np.uint64]:
    """Hash the geometry of each box, equal for equal boxes; (boxes,)."""
    hashes = np.zeros(len(boxes), np.uint64)
    for name in GEOMETRY:
        bits = (boxes[name].to_numpy(np.float64) + 0.0).view(np.uint64)  # one bit pattern of 0
        hashes = (hashes ^ bits) * _MIX
        hashes ^= hashes >> np.uint64(32)
    return hashes
