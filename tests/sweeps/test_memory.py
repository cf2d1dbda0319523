"""Memory of work on voxels: it takes what is told of it, and what cannot fit never starts."""

import tracemalloc

import numpy as np
import pandas as pd
import pytest

from lidarplace import OccupancyGrid, Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from sweeps.commands import doctor, run
from sweeps.commands.search import app as search_app
from sweeps.execution import memory
from sweeps.plan.plan import read_plan
from sweeps.results.pictures import uncovered
from sweeps.stages.pog import PogStage
from tests.refused import refused
from tests.sweeps.search_files import write_search
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import call


@pytest.mark.filterwarnings("ignore:.*are larger than 50 m")
@pytest.mark.parametrize("classes", [("Car",), ("Car", "Cyclist", "Pedestrian")])
def test_the_estimate_is_what_a_pog_takes(classes):
    roi = Roi((0, 40), (-20, 20), (0, 4), 0.16)
    everywhere = [20.0, 0.0, 2.0, 90.0, 90.0, 9.0, 0.0]
    boxes = pd.DataFrame([everywhere] * len(classes), columns=list(GEOMETRY))
    boxes = boxes.assign(scene="a", frame=0, object_id=range(len(classes)), **{"class": classes})
    frames = pd.DataFrame({"scene": "a", "frame": [0], "route": 0, "split": "train"})
    log = BoxLog(boxes, frames)
    stage = PogStage(roi, classes)
    stage.run(log)  # compiled by now
    tracemalloc.start()
    try:
        value = stage.run(log)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert np.all(value.counts[classes[0]] == 1)
    assert 0.7 * stage.need().memory < peak < 1.1 * stage.need().memory


def test_what_is_not_covered_is_summed_layer_by_layer():
    rng = np.random.default_rng(0)
    roi = Roi((0, 3), (0, 4), (0, 5), 1.0)
    grids = [OccupancyGrid(roi, n, rng.integers(0, 9, roi.shape, np.int32), 9) for n in "ab"]
    covered = rng.random(roi.shape) < 0.5
    left = np.where(covered, 0.0, grids[0].entropy + grids[1].entropy)
    np.testing.assert_allclose(uncovered(grids, covered), left.sum(axis=2), rtol=1e-6)


@pytest.fixture
def small_machine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(memory, "machine_memory", lambda: (90_000, 50_000))
    write_sweep(tmp_path, "small.yaml", detector=None, placement="line")
    return tmp_path


def test_what_cannot_fit_never_starts(small_machine):
    told = "surrogate.resolution: 1.25e+04 voxels of 0.8 m need 100.0 kB of memory (pog)"
    for arguments in (["--dry-run"], ["--dry-run", "--json"], []):
        found = call(run.app, "small.yaml", *arguments, code=2)
        assert found.stderr.startswith(told)
        assert len(found.stderr.splitlines()) == 1
        assert not (small_machine / "runs" / "store" / "pog").exists()
    assert doctor.scenes(small_machine / "small.yaml").found.startswith(told)


def test_a_cluster_has_memory_of_its_own(small_machine):
    _, plan = read_plan(small_machine / "small.yaml")
    with refused(("", "surrogate.resolution", "")):
        memory.check_memory(plan.tasks, "local")
    memory.check_memory(plan.tasks, "ray://head:10001")


def test_a_search_that_cannot_fit_never_starts(small_machine):
    path = write_search(small_machine)
    for arguments in (["--dry-run"], []):
        assert "of memory (pog)" in call(search_app, path, *arguments, code=2).stderr
