"""A search by expected recall: values, what it asks for, and mistakes."""

from functools import reduce

import pytest

from lidarplace import ExpectedRecall, Mount, Placement, Roi
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.configuration.placement import read_placement
from lidarplace.recall.detection_curve import DetectionCurve, write_curves
from lidarplace.recall.surface_cells import SurfaceCells
from sweeps.search.greedy.certificate import why_none
from sweeps.search.output.run_folder import _objective
from sweeps.search.output.terminal import greedy_warnings
from sweeps.search.problem.assess import Traffic, assess
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar
from sweeps.search.verification.robustness import _cases
from tests.sweeps.search_files import run_search, searched, train_log, write_search

LIDAR = {"beams": 8, "azimuth_steps": 400, "cloud_share": 0.5}


def objects_of(folder):
    """Those of the training split, by the library alone."""
    roi = Roi((0, 40), (-20, 20), (0, 4), 0.8)
    return ExpectedRecall.from_log(train_log(folder / "log"), roi, ["Car"], azimuth_share=0.5)


def test_a_search_by_expected_recall(tmp_path):
    search = {"objective": "expected_recall", "trials": 6}
    run, output = searched(tmp_path, search=search, robustness={"draws": 2}, lidar=LIDAR)
    output = " ".join(output.split())
    assert "expected_recall: 12 objects that count, in 3 of 3 training frames" in output
    assert "of 27 candidate mounts" in output
    assert "upper bound" in output
    assert "azimuth steps" not in output
    value = run.search.rigs["found_1"].values["expected_recall"]
    problem = read_problem(tmp_path / "small.yaml")
    rig = read_placement(run.path / "placement.yaml", problem.file.lidar.lidar())
    recall = objects_of(tmp_path).of(rig).loc["Car", "expected_recall"]
    assert value == pytest.approx(recall, rel=1e-9)
    bound, table = run.search.bound, run.robustness
    assert bound.greedy <= bound.value <= bound.by_gains
    assert value >= bound.greedy * (1 - 1e-9)  # the first trial is greedy's rig, refined
    failed = table[(table["rig"] == "found_1") & table["case"].str.endswith("fails")]
    assert len(failed) == 2
    assert (failed["share"] < 1).all()


def test_a_front_of_expected_recall_price_and_a_surrogate_of_the_pog(tmp_path):
    models = {
        "small": {"beams": 4, "azimuth_steps": 200, "price": 1},
        "large": {"beams": 16, "azimuth_steps": 400, "price": 9},
    }
    objective = ["expected_recall.Car", "price", "covered_entropy"]
    search = {"objective": objective, "models": models, "sampler": "nsga2", "trials": 6}
    run, output = searched(tmp_path, search=search, robustness=None, lidar=LIDAR)
    assert "no bound: several objectives" in output
    values = run.trials[[f"value.{name}" for name in objective]]
    assert values.notna().all().all()
    assert values["value.expected_recall.Car"].between(0, 1).all()
    assert run.search.first.unit == "of the objects"
    assert set(values["value.price"]) <= {2.0, 10.0, 18.0}


def test_a_class_without_objects_is_told_in_one_line(tmp_path):
    search = {"objective": "expected_recall"}
    path = write_search(tmp_path, classes=["Car", "Cyclist"], search=search)
    output = run_search(path, codes=(1,))
    assert "expected_recall: no Cyclist counts in the training frames" in output
    assert "Traceback" not in output


def test_curves_make_another_search(tmp_path):
    search = {"objective": "expected_recall"}
    path = write_search(tmp_path, search=search)
    assert why_none(read_problem(path)) is None
    first = read_problem(path).key
    assert first != read_problem(write_search(tmp_path)).key
    curve = DetectionCurve.model_validate({"class": "Car", "iou": 0.5, "most": 0.5, "rate": 0.1})
    write_curves(tmp_path / "curves.json", "by hand", [curve])
    surrogate = {"resolution": 0.8, "names": ["m_sog"], "curves": str(tmp_path / "curves.json")}
    two = read_problem(write_search(tmp_path, classes=["Car", "Cyclist"], search=search))
    unit = _objective(two.file.search.objective[0], two).unit
    assert unit == "of the objects, sum over 2 classes"
    mine = read_problem(write_search(tmp_path, search=search, surrogate=surrogate)).key
    assert mine != first
    write_curves(tmp_path / "curves.json", "by hand", [curve.model_copy(update={"most": 0.6})])
    assert read_problem(write_search(tmp_path, search=search, surrogate=surrogate)).key != mine


@pytest.mark.parametrize(
    ("objective", "expected"),
    [("expected_recall.Car", "trials know it"), ("expected_ig", "so do trials")],
)
def test_it_is_said_that_greedy_choice_looks_at_lidars_one_by_one(tmp_path, objective, expected):
    models = {"sized": {"name": "vlp16"}, "unknown": {"beams": 4}}
    cases = [(["sized", "unknown"], 2, True), (["unknown"], 2, False), (["sized"], 1, False)]
    for names, lidars, tells in cases:
        search = {"objective": objective, "lidars": lidars, "azimuth_stride": 1}
        search["models"] = {name: models[name] for name in names}
        path = write_search(tmp_path, search=search)
        for options in ([], ["--json"]):
            output = " ".join(run_search(path, "--dry-run", *options).split())
            assert ("ignore that the housings of LiDARs hide objects" in output) == tells
            assert (expected in output) == tells
    # The page has as cautions what this tells.
    search["greedy"], search["lidars"] = None, 2
    assert greedy_warnings(read_problem(write_search(tmp_path, search=search))) == []
    search["greedy"] = {"position_step": 0.5}
    (line,) = greedy_warnings(read_problem(write_search(tmp_path, search=search)))
    assert expected in line


SIZED = {"name": "vlp16", "azimuth_steps": 900, "size_mm": [400, 400, 400]}
"""So large that whoever is behind it misses much."""
BEHIND = tuple(MountedLidar("sized", "", Mount(x, 0.0, 2.0)) for x in (-0.5, 0.0, 0.5))


def test_a_dead_lidar_still_hides_in_recall_and_in_clouds(tmp_path):
    objectives = ["expected_recall.Car", "price"]
    search = {"objective": objectives, "models": {"sized": SIZED | {"price": 1}}, "greedy": None}
    problem = read_problem(write_search(tmp_path, search=search, lidar="vlp16"))
    objects = objects_of(tmp_path)
    lidar = problem.models["sized"]
    mounts = [item.mount for item in BEHIND]
    by_hand, gone = [], []
    for number in range(3):
        left = [*mounts[:number], *mounts[number + 1 :]]
        whole = Placement("whole", mounts, lidar)
        # Each LiDAR as it is cast in the whole rig, and then without the dead one's part.
        item = [lidar for n, lidar in enumerate(objects.objects.in_rig(whole)) if n != number]
        seen = reduce(SurfaceCells.and_, objects.objects.cells_of(item))
        by_hand.append(float(objects.recall(seen).loc["Car", "expected_recall"]))
        values = objects.of(Placement("left", left, lidar))
        gone.append(float(values.loc["Car", "expected_recall"]))
    assert min(by_hand) < min(gone)
    failing = list(_cases(BEHIND, problem.file.robustness, 0))[-3:]
    assert [case for case, _ in failing] == [f"LiDAR {n} fails" for n in (1, 2, 3)]
    traffic = Traffic({"Car": None}, objects)
    values = [assess(rig, problem.criteria, traffic).values for _, (rig,) in failing]
    assert [item["expected_recall.Car"] for item in values] == pytest.approx(by_hand, rel=1e-12)
    # A generalist gets clouds of the same: the dead LiDAR is part of the placement.
    settings = problem.placement_settings(failing[1][1][0])
    rig = settings.placement("dead", problem.models["lidar"])
    assert rig.mounts == (mounts[0], mounts[2])
    assert rig.dead == ((mounts[1], lidar),)
    assert [(item > 0).any() for item in ends_in_rig(rig)] == [True, True]
