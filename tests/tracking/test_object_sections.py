"""Sections of objects, rigs and maps: individuals, distance, direction, coverage."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tracking.findings.evidence import LEAST_INDIVIDUALS
from tracking.findings.individuals import count_individuals
from tracking.report.analysis import Analysis
from tracking.report.cautions import cautions
from tracking.report.sections.best import by_class_section
from tracking.report.sections.coverage import coverage_section, rigs_section
from tracking.report.sections.objects import (
    by_distance_section,
    by_sector_section,
    individuals_section,
)


def rows(*objects):
    """A table of test objects: scene, route, class, object_id, boxes."""
    columns = ["scene", "route", "class", "object_id", "boxes"]
    return pd.DataFrame(objects, columns=columns).assign(split="test")


def test_a_car_of_two_routes_is_one_and_equal_names_of_two_scenes_are_two():
    objects = [("a", 0, "Car", "1", 30), ("a", 1, "Car", "1", 20), ("b", 2, "Car", "1", 5)]
    table = rows(*objects, ("b", 2, "Pedestrian", "9", 7))
    car, pedestrian = count_individuals(table).to_dict("records")
    counts = {"routes": 3, "boxes": 55, "individuals": 2, "share_of_ten": 1.0}
    assert car == {"split": "test", "class": "Car", **counts}
    assert (pedestrian["boxes"], pedestrian["individuals"], pedestrian["routes"]) == (7, 1, 1)


def test_the_share_of_the_ten_is_of_the_boxes():
    table = rows(*(("a", 0, "Car", str(i), 50 if i in (3, 30) else 1) for i in range(40)))
    (row,) = count_individuals(table).to_dict("records")
    assert row["share_of_ten"] == (2 * 50 + 8) / (2 * 50 + 38)
    assert count_individuals(table[:0]).empty


def test_the_report_has_them_beside_the_boxes(run):
    table = individuals_section(Analysis(run)).tables[0].data.set_index(["split", "class"])
    assert list(table.loc[("test", "Car"), ["routes", "boxes", "individuals"]]) == [4, 420, 34]
    assert table.loc[("test", "Car"), "share_of_ten"] == pytest.approx(300 / 420)
    sentence = "Car: 420 test boxes are 34 individuals, 10 of which have 71 %"
    assert any(text.startswith(sentence) for text in cautions(Analysis(run)))


def test_few_individuals_are_a_caution(run):

    def said(own):
        return [
            s for s in cautions(Analysis(replace(run, individuals=own))) if "others may give" in s
        ]

    def cars(number):
        return rows(*(("a", i % 4, "Car", str(i), 5) for i in range(number)))

    assert said(cars(LEAST_INDIVIDUALS)) == []
    (few,) = said(cars(LEAST_INDIVIDUALS - 1))
    assert few.startswith(f"Car: {5 * (LEAST_INDIVIDUALS - 1)} test boxes are ")
    (one,) = said(cars(1))
    assert one.startswith("Car: 5 test boxes are 1 individual:")
    assert said(cars(1).assign(split="train")) == said(None) == []


def test_the_report_tells_the_spread_of_the_test_objects(run):
    """Beside that of the seeds; a folder without the table has intervals as before."""
    tables, notes = [], []
    for one in (run, replace(run, left_out=None)):
        section = by_class_section(Analysis(one))
        tables.append(section.tables[0].data)
        notes.append(section.notes)
    ours, before = tables
    assert (ours["sd_by_test_objects"] > 0).all()
    assert before["sd_by_test_objects"].isna().all()
    assert (ours["high"] - ours["low"] > before["high"] - before["low"]).all()
    widths, old = (table["high_of_lead"] - table["low_of_lead"] for table in tables)
    assert widths[1:].min() > old[1:].max()
    assert (2 * ours["half_interval_compared"] < ours["high"] - ours["low"]).all()
    assert notes[0] != notes[1]


def test_points_per_object_and_ap_are_by_ring(run):
    tables = {table.name: table for table in by_distance_section(Analysis(run)).tables}
    points, ap = tables["points-per-object-car"], tables["ap-by-distance-car"]
    assert points.head == ap.head == ("placement", "0–10 m", "10–20 m")
    car = run.points.query("`class` == 'Car' and placement == 'line'")
    row = next(r for r in points.rows if r[0] == "line")
    assert row[1:] == tuple(f"{mean:,.0f} (5 %)" for mean in car["mean"])
    assert len(ap.rows) == len(run.placements)
    assert len(ap.data) == 2 * len(run.placements)
    (row,) = [r for r in ap.rows if r[0] == "line"]
    first = ap.data.query("placement == 'line' and from_m == 0")["mean_percent"].item()
    assert row[1].startswith(f"{first:.1f} ± ")


def test_recall_by_direction_goes_from_left_to_right(run):
    section = by_sector_section(Analysis(run))
    rows = run.sector.query("`class` == 'Car' and placement == 'line' and iou == 0.7")
    means = rows.groupby("sector")["value"].mean()
    table = next(t for t in section.tables if t.name == "recall-by-direction-car")
    assert table.head == ("placement", "front left", "front", "front right")
    row = next(r for r in table.rows if r[0] == "line")
    assert row[2].startswith(f"{means['front']:.1f} ± ")
    for missing in (None, run.sector.iloc[:0]):
        assert by_sector_section(Analysis(replace(run, sector=missing))) is None


def test_maps_of_all_placements_share_their_scales(run):
    section = coverage_section(Analysis(run))
    assert len(section.figures) == 2 * len(run.placements)
    heats = [plot.data[0] for plot in section.figures]
    maps, area = run.maps, run.roi.resolution**2
    most = max(residual.max() for residual in maps.residual.values()) / area
    assert [heat.zmax for heat in heats[:2]] == [100, pytest.approx(most)]
    assert len({heat.zmax for heat in heats[1::2]}) == 1
    first = section.figures[0].layout.title.text.removesuffix(" · covered")
    np.testing.assert_allclose(heats[0].z, 100 * maps.coverage[first].T, rtol=1e-6)
    np.testing.assert_allclose(heats[1].z, maps.residual[first].T / area, rtol=1e-6)
    (dots,) = (t for t in section.figures[1].data[1:] if t.mode == "markers")
    assert [*zip(dots.x, dots.y, strict=True)] == [(m.x, m.y) for m in run.placements[first]]


def test_rigs_are_drawn_without_maps(run):
    (picture,) = rigs_section(Analysis(replace(run, maps=None))).figures
    assert len(picture.layout.updatemenus[0].buttons) == len(run.placements)
