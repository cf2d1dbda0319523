"""Wrong data and settings: refused in one line that names the place, or done."""

import shutil

import pytest

from tests.fuzz.cases import faults, outcome_of, run_case
from tests.fuzz.judge import DONE
from tests.fuzz.targets import DATA, DETECTIONS, MAPS, REPORTS, SETTINGS

EVERY = (*DATA, *DETECTIONS, *REPORTS)
COUNTS = [
    *((target, 5) for target in (*DATA, *DETECTIONS, *SETTINGS)),
    *((target, 2) for target in (*MAPS, *REPORTS)),
]


@pytest.mark.parametrize("target", EVERY, ids=[target.name for target in EVERY])
def test_right_data_is_done(target, world, tmp_path):
    place = tmp_path / "world"
    shutil.copytree(world, place)
    path = min(place.glob(target.files.split()[0]))
    assert outcome_of(target, path, place).kind == DONE


@pytest.mark.parametrize(("target", "count"), COUNTS, ids=[target.name for target, _ in COUNTS])
def test_wrong_data(target, count, world, tmp_path):
    if target in MAPS:
        pytest.importorskip("sumolib")
    assert not faults(run_case, [target], 0, count, world, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize(
    ("targets", "seed", "count"),
    [
        ((*DATA, *DETECTIONS), 1, 100),
        ((*DATA, *DETECTIONS), 2, 100),
        ((*MAPS, *REPORTS), 1, 60),
        (SETTINGS, 1, 100),
    ],
)
def test_much_wrong_data(targets, seed, count, world, tmp_path):
    assert not faults(run_case, targets, seed, count, world, tmp_path)
