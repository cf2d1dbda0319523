"""The report's sections of rigs, coverage, distance and direction, from a run folder."""

from dataclasses import replace

import numpy as np
import pytest

from tracking.report.analysis import Analysis
from tracking.report.sections.coverage import coverage_section, rigs_section
from tracking.report.sections.objects import by_distance_section, by_sector_section
from tracking.run_folders.sweep import RunFolder


@pytest.fixture(scope="module")
def run(made_up_run):
    return RunFolder.read(made_up_run)


def test_every_placement_has_a_line_in_its_ring(run):
    section = by_distance_section(Analysis(run))
    points, ap = section.figures[0], section.figures[-1]
    assert points.layout.title.text == "Points per object · Car"
    assert ap.layout.title.text == "AP by distance · Pedestrian"
    for plot in (points, ap):
        assert len(plot.data) == len(run.placements)
        assert plot.layout.xaxis.ticktext == ("0–10", "10–20")
    car = run.points.query("`class` == 'Car' and placement == 'line'")
    assert points.data[0].y.tolist() == car["mean"].tolist()
    own = run.distance.query(
        "`class` == 'Pedestrian' and placement == 'line' and metric == 'AP_R40_3D'"
    )
    assert ap.data[0].y.tolist() == own.groupby("from_m")["value"].mean().tolist()
    assert (np.asarray(ap.data[0].error_y.array) > 0).all(), "an interval over two seeds"


def test_its_tables_hold_the_raw_numbers(run):
    section = by_distance_section(Analysis(run))
    table = next(t for t in section.tables if t.name == "ap-by-distance-car")
    assert table.head == ("placement", "0–10 m", "10–20 m")
    assert len(table.rows) == len(run.placements)
    assert len(table.data) == 2 * len(run.placements)
    (row,) = [r for r in table.rows if r[0] == "line"]
    first = table.data.query("placement == 'line' and from_m == 0")["mean_percent"].item()
    assert row[1].startswith(f"{first:.1f} ± ")


def test_recall_by_direction_goes_from_left_to_right(run):
    section = by_sector_section(Analysis(run))
    car = next(p for p in section.figures if p.layout.title.text == "Recall by direction · Car")
    assert car.layout.xaxis.ticktext == ("front left", "front", "front right")
    assert len(car.data) == len(run.placements)
    own = run.sector.query("`class` == 'Car' and placement == 'line' and iou == 0.7")
    means = own.groupby("sector")["value"].mean()
    assert car.data[0].y.tolist() == pytest.approx(means[[*car.layout.xaxis.ticktext]].tolist())
    assert np.argmax(car.data[0].y) == 1
    table = next(t for t in section.tables if t.name == "recall-by-direction-car")
    assert table.head == ("placement", "front left", "front", "front right")
    row = next(r for r in table.rows if r[0] == "line")
    assert row[2].startswith(f"{means['front']:.1f} ± ")
    for missing in (None, run.sector.iloc[:0]):
        assert by_sector_section(Analysis(replace(run, sector=missing))) is None


def test_maps_of_all_placements_share_their_scales(run):
    section = coverage_section(Analysis(run))
    assert len(section.figures) == len(run.placements)
    limits = {
        tuple(trace.zmax for trace in plot.data if trace.type == "heatmap")
        for plot in section.figures
    }
    assert len(limits) == 1


def test_rigs_are_drawn_without_maps(run):
    section = rigs_section(Analysis(replace(run, maps=None)))
    (picture,) = section.figures
    assert len(picture.layout.updatemenus[0].buttons) == len(run.placements)
