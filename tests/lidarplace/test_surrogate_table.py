"""What the table says of the surrogates is what these do."""

import inspect
import math

import numpy as np
import pytest
from mypy import api

from lidarplace import Lidar, Mount, Placement, Roi, evaluate, evaluate_classes, sum_over_classes
from lidarplace.base import plotting
from lidarplace.pog.surrogates import result
from lidarplace.pog.surrogates.table import POG_SURROGATES, RAY_SURROGATES, SURROGATES
from tests.lidarplace.random_grids import random_grids

ROI = Roi(x=(0.0, 6.0), y=(-3.0, 3.0), z=(0.0, 2.0), resolution=0.25)
LIDAR = Lidar(tuple(np.radians([-40.0, -20.0, -3.0])), azimuth_steps=180)
MOUNTS = [Mount(y=y, z=2.2, roll=roll) for y, roll in ((-0.6, 0.2), (0.6, -0.2), (0.0, 0.0))]


@pytest.fixture(scope="module")
def grids():
    return random_grids(ROI)


@pytest.mark.parametrize("occlusion", [False, True])
@pytest.mark.parametrize("name", POG_SURROGATES)
def test_more_lidars_do_what_its_sense_says(grids, name, occlusion):
    own = SURROGATES[name]
    rigs = [Placement("rig", MOUNTS[:n], LIDAR) for n in (1, 2, 3)]
    asked = [name] if own.needs_rays else []
    results = [evaluate(grids["Car"], rig, surrogates=asked, occlusion=occlusion) for rig in rigs]
    values = np.array([getattr(result, name) for result in results])
    assert not own.fixed or len(set(values)) == 1
    assert np.all(np.diff(values) * own.sense > 0) or own.sense == 0
    assert (getattr(evaluate(grids["Car"], rigs[0]), name) is None) == own.needs_rays


@pytest.mark.parametrize("name", [name for name in POG_SURROGATES if SURROGATES[name].additive])
def test_those_that_are_additive_have_a_sum(grids, name):
    results = evaluate_classes(grids, Placement("rig", MOUNTS, LIDAR), surrogates=RAY_SURROGATES)
    total = math.fsum(getattr(result, name) for result in results.values())
    assert getattr(sum_over_classes(results), name) == pytest.approx(total)


def test_no_other_name_is_an_attribute(grids):
    result = evaluate(grids["Car"], Placement("rig", MOUNTS, LIDAR))
    assert {*POG_SURROGATES} < {*dir(result)}
    with pytest.raises(AttributeError, match="no attribute 's_nig'"):
        result.s_nig  # noqa: B018


def test_a_misspelt_surrogate_is_a_mistake_to_mypy(tmp_path):
    code = "from lidarplace.pog.surrogates.result import Surrogates as S\n\n\n"
    code += "def add(one: S) -> float:\n    return one.s_mig + one.covered_voxels + one.s_migg\n"
    (tmp_path / "reads.py").write_text(code)
    files = [inspect.getfile(plotting), inspect.getfile(result), str(tmp_path / "reads.py")]
    quick = ["--config-file=", "--follow-imports=skip", "--cache-dir", str(tmp_path)]
    found, _, _ = api.run([*quick, *files])
    assert [line for line in found.splitlines() if " error: " in line and "s_migg" in line], found
    assert found.count(" error: ") == 1, found
