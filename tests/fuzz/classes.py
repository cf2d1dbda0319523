"""Classes as keys: a known one is taken, a mistyped or strange one is refused by its name."""

import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import yaml

from lidarplace.logs.boxes import CLASSES
from tests.fuzz.cases import Result, copied, outcome_of
from tests.fuzz.judge import DONE, REFUSED, Outcome
from tests.fuzz.targets import SETTINGS, parts_of

MISTYPED: tuple[Callable[[str], str], ...] = (
    str.lower, str.upper, str.swapcase, "{}s".format, "{}0".format, "_{}".format,
    lambda name: name[1:], lambda name: name[:-1], lambda name: name[0] + name,
    lambda name: name.replace("a", "e") + "x", lambda name: "Dragon", lambda name: name[::-1],
)  # fmt: skip


def _ranges(kind: str, classes: dict[str, Any]) -> dict[str, Any]:
    models = {"radars": "drvegrd169", "cameras": "nuscenes_camera"}
    return {kind: [{"z": 1.0, "model": models[kind], "ranges": classes}]}


PLACES: dict[str, tuple[str, tuple[str, ...], Callable[[dict[str, Any]], Any], Any]] = {
    "radars": ("needs.yaml", ("placements", "mine"), lambda own: _ranges("radars", own), 9.0),
    "cameras": ("needs.yaml", ("placements", "mine"), lambda own: _ranges("cameras", own), 9.0),
    "factor": ("correction.yaml", (), lambda own: {"factor": own}, 0.5),
    "class_settings": ("sweep.yaml", (), lambda own: {"class_settings": own}, {"iou": [0.6, 0.4]}),
    "sample_groups": ("sweep.yaml", ("training",), lambda own: {"sample_groups": own}, 3),
    "weights": (
        *("search.yaml", ("search",)),
        *(lambda own: {"objective": {"by": "expected_ig", "weights": own}}, 1.0),
    ),
}
"""By key: the file, where it is there, and what its classes have."""
READERS = {target.files: target for target in SETTINGS if target.name != "run command"}


def run_class(key: str, seed: int, number: int, world: Path, place: Path) -> Result:
    """Write a class as a key into a copy of `world`, in the new folder `place`, and read it."""
    random = Random(f"classes {key}/{seed}/{number}")
    file, path, content, value = PLACES[key]
    name = strange = random.choice(["Car"] if file in ("search.yaml", "sweep.yaml") else CLASSES)
    if random.random() < 0.8:
        strange = random.choice(MISTYPED)(name)
    target = READERS[file]
    copied(world, place, parts_of(f"{file} {target.line}", world))
    tree = yaml.safe_load((place / file).read_text(encoding="utf-8"))
    inner = tree
    for part in path:
        inner = inner[part]
    inner |= content({strange: value})
    (place / file).write_text(yaml.safe_dump(tree), encoding="utf-8")
    outcome = outcome_of(target, place / file, place)
    shutil.rmtree(place)
    expected = DONE if strange == name else REFUSED
    if not outcome.fault and outcome.kind != expected:
        outcome = Outcome(f"{outcome.kind}, not {expected}", outcome.told)
    elif outcome.kind == REFUSED and strange not in outcome.told:
        outcome = Outcome("names no class", outcome.told)
    return Result(f"classes {key}", f"{seed} {number}", f"{strange} for {name}", outcome)
