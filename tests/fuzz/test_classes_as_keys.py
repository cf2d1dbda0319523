"""Classes as keys: a known one is taken, a mistyped or strange one is refused by its name."""

import shutil
from collections.abc import Callable

import pytest
import yaml

from tests.fuzz.cases import copied, outcome_of
from tests.fuzz.judge import DONE, REFUSED
from tests.fuzz.targets import SETTINGS, parts_of

STRANGE = ("car", "CAR", "cAR", "Cars", "Car0", "_Car", "ar", "Ca", "CCar", "Cerx", "Dragon", "raC")


def _ranges(kind: str, model: str) -> Callable[[dict[str, object]], dict[str, object]]:
    return lambda classes: {kind: [{"z": 1.0, "model": model, "ranges": classes}]}


PLACES = {
    "radars": ("needs.yaml", ("placements", "mine"), _ranges("radars", "drvegrd169"), 9.0),
    "cameras": ("needs.yaml", ("placements", "mine"), _ranges("cameras", "nuscenes_camera"), 9.0),
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


@pytest.mark.parametrize("key", PLACES)
def test_classes_as_keys(key, world, tmp_path):
    file, path, content, value = PLACES[key]
    target, place = READERS[file], tmp_path / "world"
    copied(world, place, parts_of(f"{file} {target.line}", world))
    right = (place / file).read_text(encoding="utf-8")
    for name in ("Car", *STRANGE):
        tree = yaml.safe_load(right)
        inner = tree
        for part in path:
            inner = inner[part]
        inner |= content({name: value})
        (place / file).write_text(yaml.safe_dump(tree), encoding="utf-8")
        outcome = outcome_of(target, place / file, place)
        shutil.rmtree(place / "out", ignore_errors=True)
        assert outcome.kind == (DONE if name == "Car" else REFUSED), (name, outcome.told)
        assert name == "Car" or name in outcome.told
