"""Zones of regulations: their files, and the figure of each."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from lidarplace import Lidar, Mount, Placement
from lidarplace.mounting.outline import outline
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import default_curves
from lidarplace.requirements.check_requirements import check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.presets.read import PRESETS, preset, preset_file
from lidarplace.requirements.settings import Requirements
from lidarplace.requirements.tables import Ground, case_table
from tracking.pages.requirements import requirement_map

TRUCK = Vehicle("truck", np.array([[[-6.0, -1.25, 0.4], [3.0, 1.25, 3.5]]]))
RIG = Placement("roof", [Mount(3.2, 0.0, 3.6, pitch=0.6)], lidar=Lidar.named("pandar40p"))
DOCS = Path(__file__).parents[3] / "docs/requirements.md"
ZONES = {
    "fmvss_111": ((-12.1, -6.3), (-1.52, 1.52)),
    "un_r151": ((-6.0, 3.0), (-5.5, -2.15)),
    "un_r158": ((-9.5, -6.2), (-1.25, 1.25)),
    "un_r159": ((3.8, 6.7), (-1.75, 1.75)),
    "un_r167": ((0.5, 5.0), (-5.75, 3.25)),
}


def requirements_of(value):
    return TypeAdapter(Requirements).validate_python(value)


@pytest.mark.parametrize("name", PRESETS)
def test_each_is_drawn_where_its_numbers_say(name):
    area = preset(name, TRUCK)
    assert area.x == pytest.approx(ZONES[name][0])
    assert area.y[0] == pytest.approx(ZONES[name][1])
    for settings in requirements_of(name):
        assert settings.where.preset == name
        wanted = settings.requirement(TRUCK, default_curves())
        (outcome,) = check_requirements([lay_out(wanted, TRUCK)], RIG, TRUCK)
        row = case_table([outcome]).assign(rig=RIG.name).iloc[0].to_dict()
        ground = Ground.of(outcome)
        figure = requirement_map(row, ground, RIG.name, RIG.mounts, outline(TRUCK))
        heat = next(trace for trace in figure.data if trace.type == "heatmap")
        assert figure.to_plotly_json()["layout"]["title"]["text"]
        drawn = np.isfinite(np.asarray(heat.z, float))
        for axis, places in enumerate((heat.x, heat.y)):
            seen = np.asarray(places)[drawn.any(axis=axis)]
            half = wanted.step / 2 if wanted.placed is None else 0.0
            low, high = ZONES[name][axis]
            assert seen.min() - half == pytest.approx(low, abs=wanted.step + 1e-9)
            assert seen.max() + half == pytest.approx(high, abs=wanted.step + 1e-9)


@pytest.mark.parametrize("name", PRESETS)
def test_each_number_has_its_paragraph_and_what_is_not_checked_says_so(name):
    file = preset_file(name)
    values = {number.value for number in file.numbers}
    offsets = {abs(by) for axis in (file.area.x, file.area.y) for _, by in axis} - {0.0}
    assert offsets <= values
    objects = [r.get("sizes", {}) for r in file.requirements if isinstance(r.get("sizes"), dict)]
    assert {size for sizes in objects for size in sizes.values()} - {0.3} <= values
    unchecked = not all(number.checked for number in file.numbers)
    (line,) = [
        line for line in DOCS.read_text("utf-8").splitlines() if line.startswith(f"| `{name}")
    ]
    assert ("not checked" in line) == unchecked
    assert all(number.paragraph.split(" ")[0] in line for number in file.numbers if number.checked)


def test_a_text_stands_for_all_requirements_of_a_preset():
    both = requirements_of(["un_r159", {"name": "x", "where": "un_r151", "what": "Cyclist",
                                        "at_least": {"points": 3}}])  # fmt: skip
    names = [requirement.name for requirement in both]
    assert names == ["R159 adult", "R159 child", "R159 cyclist", "x"]
