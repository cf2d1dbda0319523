"""The run folder is read whole, or the error names what is wrong."""

import shutil

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from lidarplace.logs.boxes import CLASSES
from tests.refused import refused
from tests.tracking.made_up_run import NAMES, write_run
from tracking.findings.summary import by_surrogate, deciding_surrogate, seed_means, summary_table
from tracking.kitti_iou import headline_iou
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_tables import TABLES, TRIALS


@pytest.fixture
def copy(made_up_run, tmp_path):
    return shutil.copytree(made_up_run, tmp_path / "copy")


@pytest.mark.parametrize("kind", ["Int64", "boolean", "float64", "object"])
def test_a_column_in_which_all_is_missing_has_no_kind(copy, kind):
    trials = pd.read_parquet(copy / "trials.parquet")
    trials["detector"] = pd.Series([None] * len(trials), dtype=kind)
    trials.to_parquet(copy / "trials.parquet")
    assert (RunFolder.read(copy).trials["detector"] == "").all()


def test_a_training_that_diverged_has_infinity(copy):
    curves = copy / "curves.parquet"
    pd.read_parquet(curves).assign(value=np.inf).to_parquet(curves)
    assert np.isinf(RunFolder.read(copy).curves["value"]).all()


@pytest.mark.parametrize("kind", ["Int64", "Float32", "object"])
def test_missing_numbers_of_any_kind_are_nan(copy, kind):
    curves = pd.read_parquet(copy / "curves.parquet")
    number = None if kind == "object" else 1
    curves["value"] = pd.Series([number, *[None] * (len(curves) - 1)], dtype=kind)
    curves.to_parquet(copy / "curves.parquet")
    values = RunFolder.read(copy).curves["value"]
    assert values.dtype == np.float64
    assert values.notna().sum() == (number is not None)


@pytest.mark.parametrize("file", ["results", "surrogates", "trials", "sampling_error"])
def test_whole_tables_that_are_there_twice_are_named(copy, file):
    path = copy / f"{file}.parquet"
    table = pd.read_parquet(path)
    pd.concat([table, table]).to_parquet(path)
    with refused(rf"{file}\.parquet: duplicate rows 0 and {len(table)} "):
        RunFolder.read(copy)


def test_optional_files_may_be_missing(copy):
    for name in ("curves.parquet", "maps.npz", "frame.npz", "found.parquet", "failures.npz"):
        (copy / name).unlink()
    run = RunFolder.read(copy)
    assert (run.curves, run.maps, run.frame) == (None, None, None)
    assert (run.found, run.failures) == (None, None)
    assert run.tasks is not None


def test_what_is_written_is_read(run, tmp_path):
    (again := tmp_path / "again").mkdir()
    shutil.copy(run.path / "config.yaml", again)
    for written in (run.sweep, run.maps, run.frame, run.failures):
        written.write(again)
    tables = [table for table in TABLES if getattr(run, table.name) is not None]
    assert len(tables) > 10
    for table in tables:
        table.write(getattr(run, table.name), again)
    read = RunFolder.read(again)
    assert read.sweep == run.sweep
    assert (tuple(read.placements), read.classes, read.axes) == (NAMES, CLASSES, ())
    assert read.placements["line"][0].y == -0.6
    assert read.maps.pog["Car"].shape == read.roi.shape[:2] == (40, 40)
    for table in tables:
        assert_frame_equal(getattr(read, table.name), getattr(run, table.name))
    for name in ("maps", "frame", "failures"):
        np.testing.assert_equal(vars(getattr(read, name)), vars(getattr(run, name)))


def test_a_table_is_written_only_as_it_has_to_be_read(run, tmp_path):
    with refused(("trials.parquet", "seconds", "'long'")):
        TRIALS.write(run.trials.assign(seconds="long"), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_older_tasks_are_of_unknown_times(copy):
    assert RunFolder.read(copy).tasks["started"].notna().any()
    tasks = pd.read_parquet(copy / "tasks.parquet")
    tasks[["stage", "label", "seconds", "cached"]].to_parquet(copy / "tasks.parquet")
    read = RunFolder.read(copy).tasks
    assert read[["started", "ended", "peak_memory"]].isna().all(axis=None)
    assert (read["node"] == "").all()
    assert not read["batch_size_reduced"].any()


def test_a_sweep_without_detectors_keeps_its_axes(tmp_path):
    folder = write_run(tmp_path / "alone", names=["a", "b"], detectors=(), densities=(40, 120))
    run = RunFolder.read(folder)
    assert run.axes == ("scene.density",)
    assert run.results.empty
    for table in (run.results, run.left_out, run.distance):
        assert "scene.density" in table.columns
    assert (run.trials["detector"] == "").all()
    assert run.frame is None
    assert run.maps is not None


def test_means_over_seeds(run):
    means = seed_means(run.results)
    same = "placement == 'center' and `class` == 'Car' and metric == 'AP_R40_BEV' and iou == 0.5"
    row, values = means.query(same).iloc[0], run.results.query(same)["value"]
    assert row["mean"] == pytest.approx(np.mean(values))
    assert row["sd"] == pytest.approx(np.std(values, ddof=1))
    assert row["seeds"] == 2
    assert (means.loc[means["class"] == "Cyclist", "seeds"] == 0).all()


def test_the_summary_has_a_row_a_placement_best_first(run):
    table = summary_table(run)
    assert sorted(table["placement"]) == sorted(NAMES)
    assert table["Car 3D@0.7"].is_monotonic_decreasing
    assert table.columns.tolist() == [
        *("placement", "seeds", "Car S-MIG", "Car E-IG", "covered entropy", "Car 3D@0.7", "sd"),
        *("Car BEV@0.5", "Car BEV@0.7", "Pedestrian BEV@0.5", "recall@0.5"),
    ]
    line = table.set_index("placement").loc["line"]
    covered = run.surrogates.query("placement == 'line' and surrogate == 'covered_entropy'")
    assert line["covered entropy"] == pytest.approx(covered["value"].sum())
    rows = run.results.query("placement == 'line' and `class` == 'all'")
    assert line["recall@0.5"] == pytest.approx(rows["value"].mean())


def test_the_summary_tells_axes_and_detectors_apart(tmp_path):
    folder = write_run(tmp_path / "axes", ["a", "b"], detectors=("x", "y"), densities=(40, 120))
    run = RunFolder.read(folder)
    assert run.axes == ("scene.density",)
    table = summary_table(run)
    assert len(table) == 2 * 2 * 2
    assert not table.duplicated(["placement", "detector", "scene.density"]).any()
    one = "placement == 'a' and `scene.density` == 120"
    row = table.query(f"{one} and detector == 'y'").iloc[0]
    s_mig = run.surrogates.query(f"{one} and `class` == 'Car' and surrogate == 's_mig'")
    assert row["Car S-MIG"] == s_mig["value"].item()


def test_without_results_the_summary_ranks_by_expected_recall(tmp_path):
    names = [f"p{i:02d}" for i in range(30)]
    run = RunFolder.read(write_run(tmp_path / "alone", names, detectors=(), densities=(40, 120)))
    table = summary_table(run)
    assert table.columns.tolist() == [
        *("placement", "scene.density"),
        *(f"{name} E-recall" for name in ("Car", "Cyclist", "Pedestrian")),
        *("E-recall", "covered entropy", "S-MIG"),
    ]
    for density, part in table.groupby("scene.density"):
        rows = run.surrogates[run.surrogates["scene.density"] == density]
        sums = rows.groupby(["surrogate", "placement"])["value"].sum()
        best = sums["expected_recall"].nlargest(20) / 3
        assert part["placement"].tolist() == best.index.tolist()
        assert part["E-recall"].tolist() == pytest.approx(best.tolist())
        assert part["S-MIG"].tolist() == pytest.approx(sums["s_mig"][best.index].tolist())


@pytest.mark.parametrize(
    ("computed", "decides"),
    [
        (["s_mig", "covered_entropy"], "covered_entropy"),
        (["s_mig", "expected_points"], "expected_points"),
        (["s_mig"], "s_mig"),
        (["covered_entropy", "expected_ig", "expected_recall"], "expected_recall"),
        ([], "expected_recall"),
    ],
)
def test_what_was_computed_decides(tmp_path, computed, decides):
    folder = write_run(tmp_path / "alone", names=["a", "b", "c"], detectors=())
    surrogates = pd.read_parquet(folder / "surrogates.parquet")
    rows = surrogates[surrogates["surrogate"].isin(computed)]
    rows.to_parquet(folder / "surrogates.parquet")
    run = RunFolder.read(folder)
    assert deciding_surrogate(run.surrogates) == decides
    total = rows[rows["surrogate"] == decides].groupby("placement")["value"].sum()
    order = total.sort_values(ascending=False).index.tolist()
    assert by_surrogate(run.surrogates) == summary_table(run)["placement"].tolist() == order


def test_results_need_no_covered_entropy(copy):
    surrogates = pd.read_parquet(copy / "surrogates.parquet")
    surrogates[surrogates["surrogate"] == "s_mig"].to_parquet(copy / "surrogates.parquet")
    table = summary_table(RunFolder.read(copy))
    assert table.columns[:4].tolist() == ["placement", "seeds", "Car S-MIG", "Car 3D@0.7"]


def test_the_headline_iou_is_kittis_where_it_was_evaluated():
    results = pd.DataFrame({"class": ["Car", "Car", "Cyclist"], "iou": [0.5, 0.7, 0.25]})
    results = results.assign(metric="AP_R40_3D")
    assert headline_iou(results, "Car") == 0.7
    assert headline_iou(results, "Cyclist") == 0.25
    assert headline_iou(results, "Pedestrian") == 0.5


@pytest.mark.parametrize("name", ["maps", "frame"])
def test_a_damaged_file_of_arrays_is_named(made_up_run, tmp_path, name):
    run = shutil.copytree(made_up_run, tmp_path / "run")
    data = (path := run / f"{name}.npz").read_bytes()
    for length in range(0, len(data), len(data) // 8):
        path.write_bytes(data[:length])
        with refused((f"{name}.npz", "", "")):
            RunFolder.read(run)
