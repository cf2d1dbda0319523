"""The report's sections of rigs, coverage, distance and direction, from a run folder."""

from dataclasses import replace

import numpy as np
import pytest

from tracking.report.analysis import Analysis
from tracking.report.sections.coverage import coverage_section, rigs_section
from tracking.report.sections.objects import by_distance_section, by_sector_section


def test_points_per_object_and_ap_are_by_ring(run):
    tables = {table.name: table for table in by_distance_section(Analysis(run)).tables}
    points, ap = tables["points-per-object-car"], tables["ap-by-distance-car"]
    assert points.head == ap.head == ("placement", "0–10 m", "10–20 m")
    car = run.points.query("`class` == 'Car' and placement == 'line'")
    row = next(r for r in points.rows if r[0] == "line")
    assert row[1:] == tuple(f"{mean:,.1f} (5 %)" for mean in car["mean"])
    assert len(ap.rows) == len(run.placements)
    assert len(ap.data) == 2 * len(run.placements)
    (row,) = [r for r in ap.rows if r[0] == "line"]
    first = ap.data.query("placement == 'line' and from_m == 0")["mean_percent"].item()
    assert row[1].startswith(f"{first:.1f} ± ")


def test_recall_by_direction_goes_from_left_to_right(run):
    section = by_sector_section(Analysis(run))
    own = run.sector.query("`class` == 'Car' and placement == 'line' and iou == 0.7")
    means = own.groupby("sector")["value"].mean()
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
