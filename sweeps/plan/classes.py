"""The classes of a point and the log that it reads: are they there, and how large are they?"""

import pandas as pd

from lidarplace.base.class_names import counts_of, listed
from lidarplace.base.errors import InputError, at
from lidarplace.base.suggestions import did_you_mean
from lidarplace.logs.boxes import CLASSES
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.file import reading
from sweeps.configuration.sweep import Point
from training.typical_objects import TypicalObject, typical_objects


def boxes_by_split(scene: LogScene) -> dict[str, pd.DataFrame]:
    """Boxes of the frames to train on and to test on. Raises ConfigError: the log cannot be
    read."""
    with reading("scene"):
        train = test = scene.read()
        if scene.test_folder is not None:
            test = scene.model_copy(update={"folder": scene.test_folder}).read()
    found = {}
    for split, log in {"train": train, "test": test}.items():
        frames = log.frames.loc[log.frames["split"] == split, "frame"]
        found[split] = log.boxes[log.boxes["frame"].isin(frames)]
    return found


def check_classes(point: Point, boxes: dict[str, pd.DataFrame]) -> list[str]:
    """What is to be known of classes that the training frames of a log lack, a sentence each.
    Raises InputError for a class that the configuration names by itself. Of the three that are
    meant unless others are named, some may be missing, or all where nothing is there at all."""
    assert isinstance(point.scene, LogScene)
    counts = {split: counts_of(table["class"]) for split, table in boxes.items()}
    missing = [name for name in point.classes if name not in counts["train"]]
    none = len(missing) == len(point.classes) and bool(counts["train"])
    said, where = [], point.scene.name
    for name in missing:
        if tests := counts["test"].get(name):
            why = (
                f"{where}: {name} has {tests:,} boxes in the test frames and none in the training "
                "frames, from which surrogates are computed and detectors learn"
            )
        else:
            hint, there = did_you_mean(name, counts["train"]), listed(counts["train"])
            why = f"{where}: no box of class {name} in the training frames{hint}; found {there}"
        if none or name not in CLASSES:
            raise InputError(why, key="classes")
        said.append(f"{why}.")
    return said


def typical_of(point: Point, boxes: dict[str, pd.DataFrame] | None) -> tuple[TypicalObject, ...]:
    """Of the classes whose anchors are not the preset's, in the order of the classes, by
    `boxes_by_split` of a log; None: traffic is simulated, and all stand on the ground. Raises
    InputError: the boxes of a class have no size."""
    found = []
    for name in point.classes:
        size = point.class_settings[name].size if name in point.class_settings else None
        if size is None and name in CLASSES:
            continue
        measured = TypicalObject(name, size or (1.0, 1.0, 1.0))
        if boxes is not None and name in set(boxes["train"]["class"]):
            with at(key=f"class_settings.{name}.size"):
                (measured,) = typical_objects(boxes["train"], [name])
        found.append(TypicalObject(name, size or measured.size, measured.bottom))
    return tuple(found)
