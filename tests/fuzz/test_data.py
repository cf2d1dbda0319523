"""Wrong data, wherever it is read: refused in one line that names the place, or done."""

import shutil

import pytest

from tests.fuzz.cases import faults, outcome_of, run_case
from tests.fuzz.judge import DONE
from tests.fuzz.targets import DATA, DETECTIONS, MAPS, REPORTS


def names(targets):
    return [target.name for target in targets]


EVERY = (*DATA, *DETECTIONS, *REPORTS)


@pytest.mark.parametrize("target", EVERY, ids=names(EVERY))
def test_right_data_is_done(target, world, tmp_path):
    place = tmp_path / "world"
    shutil.copytree(world, place)
    path = min(place.glob(target.files.split()[0]))
    assert outcome_of(target, path, place).kind == DONE


@pytest.mark.parametrize("target", [*DATA, *DETECTIONS], ids=names((*DATA, *DETECTIONS)))
def test_data(target, world, tmp_path):
    assert not faults(run_case, [target], 0, 5, world, tmp_path)


@pytest.mark.parametrize("target", MAPS, ids=names(MAPS))
def test_maps(target, world, tmp_path):
    pytest.importorskip("sumolib")
    assert not faults(run_case, [target], 0, 2, world, tmp_path)


@pytest.mark.parametrize("target", REPORTS, ids=names(REPORTS))
def test_reports(target, world, tmp_path):
    assert not faults(run_case, [target], 0, 2, world, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_much_data(seed, world, tmp_path):
    assert not faults(run_case, (*DATA, *DETECTIONS), seed, 100, world, tmp_path)


@pytest.mark.long
def test_many_maps_and_reports(world, tmp_path):
    assert not faults(run_case, (*MAPS, *REPORTS), 1, 60, world, tmp_path)
