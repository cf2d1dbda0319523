"""Detections in a wrong convention: each is named, and no right detector is rejected."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import sweeps.benchmark
from lidarplace.logs.box_log import read_box_log
from lidarplace.logs.boxes import CLASSES, GEOMETRY, SIZE, full_poses
from lidarplace.scenes.datasets.se3 import Poses
from training.sanity_checks.check import implausible_detections
from training.sanity_checks.sample import Sample

LOG = read_box_log(Path(sweeps.benchmark.__file__).parent / "log")
OTHERS = {name: CLASSES[number - 1] for number, name in enumerate(CLASSES)}


def traffic(random, count):
    """Frames in a row, and the boxes in front of the vehicle."""
    start = random.integers(len(LOG.frames) - count)
    frames = LOG.frames.iloc[start : start + count].reset_index(drop=True)
    boxes = LOG.boxes[LOG.boxes["frame"].isin(frames["frame"])]
    return frames, boxes[boxes["x"].between(0, 40) & boxes["y"].between(-20, 20)]


def detected(random, frames, boxes, recall, noise, alarms):
    """Detections of a share of the boxes, off by `noise`, and false alarms for each box."""
    hits = boxes[random.random(len(boxes)) < recall]
    wrong = boxes.sample(int(alarms * len(boxes)), replace=True, random_state=random)
    places = random.uniform([0, -20], [40, 20], (len(wrong), 2))
    wrong = wrong.assign(frame=random.choice(frames["frame"], len(wrong)), x=places[:, 0])
    wrong = wrong.assign(y=places[:, 1], score=random.beta(2, 4, len(wrong)))
    detections = pd.concat(
        [hits.assign(score=random.beta(5, 2, len(hits))), wrong], ignore_index=True
    )
    offsets = random.normal(0, noise, (len(detections), 3)) * [1, 1, 0.5]
    detections[[*"xyz"]] += offsets
    detections[list(SIZE)] *= np.exp(random.normal(0, noise / 2, (len(detections), 3)))
    detections["yaw"] += random.normal(0, noise, len(detections)) + np.pi * (
        random.random(len(detections)) < 0.1
    )
    return detections[["frame", "class", *GEOMETRY, "score"]]


def in_world(detections, frames):
    poses = full_poses(frames)
    turned, origin = zip(*(poses[frame] for frame in detections["frame"]), strict=True)
    posed = Poses.of_boxes(detections).posed_by(
        Poses(np.array(origin), Rotation.from_matrix(turned))
    )
    return detections.assign(**dict(zip("xyz", posed.position.T, strict=True)), yaw=posed.yaw)


def renumbered(detections, numbers):
    """Frame n of the traffic becomes `numbers[n]`."""
    return detections.assign(frame=numbers[detections["frame"] - detections["frame"].min()])


def scaled(detections, columns, factor):
    return detections.assign(**{name: factor * detections[name] for name in columns})


WRONG = {
    "x and y swapped:": lambda d, _: d.assign(x=d["y"], y=d["x"]),
    "x and y swapped and yaw as 90 degrees less yaw": (
        lambda d, _: d.assign(x=d["y"], y=d["x"], yaw=np.pi / 2 - d["yaw"])
    ),
    "with y mirrored:": lambda d, _: d.assign(y=-d["y"]),
    "with y mirrored and yaw mirrored": lambda d, _: d.assign(y=-d["y"], yaw=-d["yaw"]),
    "x and y turned by -90 degrees": (
        lambda d, _: d.assign(x=-d["y"], y=d["x"], yaw=d["yaw"] + np.pi / 2)
    ),
    "with yaw mirrored": lambda d, _: d.assign(yaw=-d["yaw"]),
    "yaw turned by 90 degrees, or": lambda d, _: d.assign(yaw=d["yaw"] + np.pi / 2),
    "or length and width swapped": lambda d, _: d.assign(length=d["width"], width=d["length"]),
    "z at the bottom": lambda d, _: d.assign(z=d["z"] - d["height"] / 2),
    "from its value, as from a LiDAR": lambda d, _: d.assign(z=d["z"] - 1.73),
    "places and sizes in millimetres": lambda d, _: scaled(d, GEOMETRY[:6], 1e3),
    "places in millimetres": lambda d, _: scaled(d, "xyz", 1e3),
    "sizes in centimetres": lambda d, _: scaled(d, SIZE, 1e2),
    "sizes as half of an object": lambda d, _: scaled(d, SIZE, 0.5),
    "as boxes in the world": in_world,
    "of the frame before": (
        lambda d, f: renumbered(d, f["frame"].to_numpy() + 1)[d["frame"] < f["frame"].max()]
    ),
    "with all frames reversed": lambda d, f: renumbered(d, f["frame"].to_numpy()[::-1]),
    "rows equal another one": lambda d, _: pd.concat([d, d]),
    "those of": lambda d, _: d.assign(**{"class": d["class"].map(OTHERS)}),
    "as percent are": lambda d, _: d.assign(score=100 * d["score"]),
    "as logits are": lambda d, _: d.assign(score=np.log(d["score"] / (1 - d["score"]))),
    "a hit has a higher score": lambda d, _: d.assign(score=-d["score"]),
}
"""Text of the problem -> the mistake."""


def problems(*tables):
    return [value.problem for value in implausible_detections(Sample.of(*tables))]


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.long) for n in range(1, 9))]
)
def test_every_wrong_convention_is_named(seed):
    random = np.random.default_rng([50, seed])
    frames, boxes = traffic(random, 100)
    manner = random.uniform([0.4, 0.05, 0.2], [0.95, 0.25, 2.0])
    right = detected(random, frames, boxes, *manner)
    assert not problems(right, boxes, frames)
    for text, change in WRONG.items():
        first, *more = problems(change(right, frames), boxes, frames) or [""]
        assert text in f"{first}:", (text, manner)
        assert not more, (text, manner)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.long) for n in range(1, 9))]
)
def test_no_detector_in_our_convention_is_rejected(seed):
    """Poor ones, with few frames or classes, constant angles or sizes, biases and random scores."""
    random = np.random.default_rng([51, seed])
    for count in (1, 3, 10, 100) if seed == 0 else (1, 1, 2, 3, 5, 10, 30, 100):
        frames, boxes = traffic(random, count)
        right = detected(random, frames, boxes, *random.uniform([0.2, 0, 0], [1, 0.5, 8]))
        size = boxes.groupby("class")[list(SIZE)].median().reindex(right["class"])
        for other in (
            right,
            right[right["class"] == random.choice(CLASSES)],
            right.assign(yaw=0.0),
            right.assign(**dict(zip(SIZE, size.to_numpy().T, strict=True))),
            right.assign(score=random.random(len(right))),
            right.assign(x=right["x"] + 0.3, y=right["y"] - 0.2, z=right["z"] + 0.3),
            scaled(right, SIZE, 0.8),
            right[:0],
        ):
            assert not problems(other, boxes, frames), (count, len(other))
