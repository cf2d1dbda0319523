"""Pages of a sweep draw the vehicle of its configuration."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lidarplace import Lidar, Mount
from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.vehicle import Vehicle
from tracking.figures.kit.vehicle_lines import vehicle_in_space
from tracking.mlflow.pictures import draw_rig
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.report.decision.rigs import rigs_section as decision_rigs_section
from tracking.report.sections.clouds import clouds_section
from tracking.report.sections.coverage import coverage_section, rigs_section
from tracking.run_folders.json_file import MOST_DRAWN, Surroundings, Triangles, drawn_vehicle
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import SweepResult

SHUTTLE = {"vehicle": [[[-2.5, -1.0, 0.25], [2.25, 1.0, 2.5]]], "vehicle_mesh": None}
SURFACE = {
    "vertices": [[3, 0, 0.25], [-2.75, 1.125, 0.25], [-2.75, -1.125, 0.25], [-2.75, 0, 2.75]],
    "faces": [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
}
CASES = [
    (SHUTTLE, (-2.5, 2.25, -1.0, 1.0, 0.25, 2.5)),
    ({"vehicle": [], "vehicle_mesh": SURFACE}, (-2.75, 3.0, -1.125, 1.125, 0.25, 2.75)),
]
"""Keys of `sweep.json`, and the lowest and highest x, y and z."""


def sections_of(run: Path, **keys) -> list[Section]:
    """Make the sections that draw a vehicle, of a run folder with further keys in `sweep.json`."""
    sweep_json = json.loads((run / SweepResult.FILE).read_text()) | keys
    whole = replace(RunFolder.read(run), sweep=SweepResult.model_validate(sweep_json))
    analysis = Analysis(whole)
    best = analysis.recommended[0]
    sections = [make(analysis) for make in (rigs_section, coverage_section, clouds_section)]
    return [*sections, decision_rigs_section(best)]


def extents(sections: list[Section], kind: str, axes: str) -> set[tuple[float, ...]]:
    """Compute the extents of the traces of a kind, of scatters those that fill themselves."""
    return {
        tuple(float(end) for axis in axes for end in (np.nanmin(t[axis]), np.nanmax(t[axis])))
        for section in sections
        for plot in section.figures
        for t in plot.data
        if t.type == kind and (kind != "scatter" or (t.fill == "toself" and len(t.x)))
    }


@pytest.mark.parametrize(("told", "extent"), CASES)
def test_boxes_and_meshes_are_drawn(made_up_run, told, extent):
    sections = sections_of(made_up_run, **told)
    top, side = extent[:4], extent[:2] + extent[4:]
    for section in sections:
        assert extents([section], "scatter", "xy") in ({top}, {top, side})
        assert not any("a sedan" in note for note in section.notes)
    assert extents(sections, "mesh3d", "xyz") == {extent}
    assert any("the vehicle in orange" in note for note in sections[1].notes)


def test_older_run_folders_have_the_sedan_of_the_clouds(made_up_run):
    assert "vehicle" not in json.loads((made_up_run / SweepResult.FILE).read_text())
    sections = sections_of(made_up_run)
    ends = {tuple(np.round(extent, 9).tolist()) for extent in extents(sections, "scatter", "xy")}
    assert ends == {(-2.3, 2.3, -0.95, 0.95), (-2.3, 2.3, 0.0, 1.5)}
    assert any("a sedan in orange" in note for note in sections[1].notes)


def test_boxes_and_a_mesh_are_one_surface():
    body = drawn_vehicle(SHUTTLE["vehicle"], Triangles(**SURFACE))
    surface, lines = vehicle_in_space(body)
    corners = np.stack([surface.x, surface.y, surface.z], axis=1)
    faces = np.stack([surface.i, surface.j, surface.k], axis=1)
    assert corners[faces[:12]].reshape(-1, 3).min(axis=0).tolist() == [-2.5, -1.0, 0.25]
    drawn = {frozenset(map(tuple, triangle)) for triangle in corners[faces[12:]].tolist()}
    vertices = [*map(tuple, SURFACE["vertices"])]
    assert drawn == {frozenset(vertices[i] for i in face) for face in SURFACE["faces"]}
    assert np.nanmax(lines.z) == 2.5  # edges of the boxes alone
    assert vehicle_in_space(drawn_vehicle((), None)) == []


def test_lanes_and_buildings_around_poles_are_drawn(made_up_run):
    """On maps, next to rigs and in 3D, also with keep-outs; nothing is called a vehicle."""
    site = {"buildings": [[20, 5, 4, 10, 6, 8, 0]], "lanes": [[0, 0, 0, 30, 2]]}
    for keep_outs in ([], [[[1, 1, 0], [2, 2, 3]]]):
        sections = sections_of(made_up_run, site=site, vehicle=keep_outs)
        drawn = extents(sections, "scatter", "xy")
        assert (15.0, 25.0, 2.0, 8.0) in drawn
        maps = [plot for plot in sections[1].figures if plot.data[0].type == "heatmap"]
        assert maps
        assert all(len(plot.data[1].x) == 4 * 3 for plot in maps)
        assert (15.0, 25.0, 2.0, 8.0, 0.0, 8.0) in extents(sections, "mesh3d", "xyz")
        words = " ".join(note for section in sections for note in section.notes)
        titles = {plot.layout.title.text for section in sections for plot in section.figures}
        assert "vehicle" not in words + str(titles)
        assert "lanes and buildings" in words
        texts = sections[0].figures[0].select_traces({"type": "scatter3d", "mode": "text"})
        rings = next(texts)
        assert (rings.x[0], rings.y[0]) == (0.0, 10.0), "around the origin"
    poles = drawn_vehicle((), None, Surroundings.model_validate(site))
    assert Surroundings.of(poles).model_dump(mode="json") == site
    assert (Surroundings.of(None), Surroundings.of(Vehicle.car())) == (None, None)


def test_a_fine_mesh_is_written_coarse():
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 4, 100), np.linspace(0, 2, 100)))
    at = np.arange(10_000).reshape(100, 100)[:-1, :-1].ravel()
    faces = np.concatenate([[at, at + 1, at + 100], [at + 1, at + 101, at + 100]], axis=1).T
    fine = Mesh(np.stack([x, y, np.sin(x)], axis=1), faces)
    coarse = Triangles.of(fine)
    assert 1000 < len(coarse.faces) <= MOST_DRAWN < len(fine.faces)
    assert len(coarse.mesh.faces) == len(coarse.faces)


def test_the_picture_of_a_trial_has_the_vehicle(tmp_path):
    from matplotlib.image import imread

    mounts, lidars = [Mount(z=3.0)], [Lidar.paper()]
    long = Vehicle("bus", np.array([[[-6.0, -1.2, 0.3], [6.0, 1.2, 2.9]]]))
    drawn = []
    for name, vehicle in (("car", None), ("bus", long)):
        draw_rig(tmp_path / f"{name}.png", "rig", mounts, lidars, vehicle)
        drawn.append(imread(tmp_path / f"{name}.png"))
    assert drawn[0].shape == drawn[1].shape
    assert not np.array_equal(*drawn)
