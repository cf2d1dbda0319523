"""Classes of a log: whether it has objects of them, and how large these are."""

from collections.abc import Mapping, Sequence

import pandas as pd

from lidarplace.base.class_names import counts_of, listed
from lidarplace.base.errors import InputError, at
from lidarplace.base.suggestions import did_you_mean
from lidarplace.logs.box_log import of_split
from lidarplace.logs.boxes import CLASSES
from lidarplace.scenes.kinds import Scene
from lidarplace.scenes.recorded import LogScene
from lidarplace.scenes.site import Site
from sweeps.configuration.file import reading
from sweeps.configuration.point import ClassSettings
from sweeps.plan.planning import Planning
from training.typical_objects import TypicalObject, typical_objects


def typical_objects_of(
    planning: Planning,
    seen: tuple[Scene, Site | None],
    classes: tuple[str, ...],
    settings: tuple[tuple[str, ClassSettings], ...],
) -> tuple[TypicalObject, ...]:
    """Return the objects of classes without anchors, and caution about the classes of a log.

    `seen`: scene, and the site from which it is seen, if any."""
    scene, site = seen
    if not isinstance(scene, LogScene):
        return _typical_of(classes, dict(settings), None)
    boxes = planning.once(_boxes_by_split, scene, site)
    planning.caution(*_left_out(scene, site))
    with reading("scene"):
        planning.caution(*scene.cautions())
    planning.caution(*_check_classes(scene, classes, boxes))
    return _typical_of(classes, dict(settings), boxes)


def _boxes_by_split(scene: LogScene, site: Site | None) -> dict[str, pd.DataFrame]:
    """Return the boxes of the training and of the test frames.

    Raises ConfigError: the log cannot be read."""
    with reading("scene"):
        train = test = scene.read(site)
        if scene.test_folder is not None:
            test = scene.model_copy(update={"folder": scene.test_folder}).read(site)
    return {split: of_split(log, split).boxes for split, log in (("train", train), ("test", test))}


def _left_out(scene: LogScene, site: Site | None) -> list[str]:
    """Return a caution about the frames of a log in which nothing is known of a site."""
    count, near = sum(scene.frame_counts()), sum(scene.frame_counts(site))
    if site is None or near == count:
        return []
    return [
        f"{count - near:,} of {count:,} frames are left out: the recording vehicle is not within "
        f"{site.within:g} m of the site, or its pose is unknown."
    ]


def _check_classes(
    scene: LogScene, classes: Sequence[str], boxes: Mapping[str, pd.DataFrame]
) -> list[str]:
    """Return a caution for each class that the training frames of a log lack.

    Raises InputError for a class that the configuration names by itself. Of the three default
    classes some may be missing, or all in a log without any box."""
    counts = {split: counts_of(table["class"]) for split, table in boxes.items()}
    missing = [name for name in classes if name not in counts["train"]]
    none = len(missing) == len(classes) and bool(counts["train"])
    cautions = []
    for name in missing:
        if tests := counts["test"].get(name):
            problem = (
                f"{scene.name}: {name} has {tests:,} boxes in the test frames and none in the "
                "training frames, from which surrogates are computed and detectors learn"
            )
        else:
            hint, listing = did_you_mean(name, counts["train"]), listed(counts["train"])
            problem = f"{scene.name}: no box of class {name} in the training frames{hint}"
            problem += f"; found {listing}"
        if none or name not in CLASSES:
            raise InputError(problem, key="classes")
        cautions.append(f"{problem}.")
    return cautions


def _typical_of(
    classes: Sequence[str],
    settings: Mapping[str, ClassSettings],
    boxes: Mapping[str, pd.DataFrame] | None,
) -> tuple[TypicalObject, ...]:
    """Return a typical object of each class without anchors in a preset, in the order of classes.

    `boxes`: of `_boxes_by_split`; None: traffic is simulated, and all stand on the ground. Raises
    InputError: the boxes of a class have no size."""
    objects = []
    for name in classes:
        size = settings[name].size if name in settings else None
        if size is None and name in CLASSES:
            continue
        measured = TypicalObject(name, size or (1.0, 1.0, 1.0))
        if boxes is not None and name in set(boxes["train"]["class"]):
            with at(key=f"class_settings.{name}.size"):
                (measured,) = typical_objects(boxes["train"], [name])
        objects.append(TypicalObject(name, size or measured.size, measured.bottom))
    return tuple(objects)
