"""Pages of every kind in a browser: nothing is wider than the screen, no box ends within a row."""

from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
import yaml

from lidarplace.viewing.page import write_page as write_figures
from sweeps.calibration.checks_section import checks_section
from sweeps.calibration.curves_section import curves_section
from sweeps.calibration.left_out import check
from sweeps.commands.requirements import app as requirements
from tests.lidarplace.studio.browsers import GUARD_S, chromium, chromium_program
from tests.sweeps.test_requirements_command import SMALL
from tests.sweeps.toy import call
from tests.tracking.made_up_run import report_of, write_run
from tests.tracking.made_up_search import write_search
from tracking.pages.html_page import SECTIONS_ALONE, write_page
from tracking.search_report.build import build_search_report

WIDER = """() => {
  const inScroll = element => { for (let box = element.parentElement; box; box = box.parentElement)
    if (['auto', 'scroll', 'hidden'].includes(getComputedStyle(box).overflowX)) return true; };
  return Array.from(document.body.querySelectorAll('*'))
    .filter(element => element.getBoundingClientRect().right > innerWidth + 1 && !inScroll(element))
    .map(element => `${element.tagName}.${element.className}: ${element.textContent.slice(0, 60)}`);
}"""
"""Elements that end beyond the right edge, but for those in a box that scrolls."""
CUT = """() => Array.from(document.querySelectorAll('.table.tall'))
  .filter(box => box.clientHeight && !Array.from(box.querySelectorAll('tr'))
    .some(row => Math.abs(row.offsetTop + row.offsetHeight - box.clientHeight) <= 2))
  .map(box => box.getAttribute('aria-label'))"""
"""Tables whose box ends within a row."""


def observations() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    cells = rng.integers(0, 200, 400)
    seen = pd.DataFrame({"cells": cells, "points": 2 * cells, "found": rng.random(400) < 0.5})
    seen = seen.astype(float).assign(
        scene="s", route="s 1", iou=0.5, object_id=np.arange(400) % 200
    )
    return seen.assign(rig=np.repeat(["a", "b"], 200), **{"class": "Car"})


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    chromium_program()
    folder = tmp_path_factory.mktemp("pages")
    report = report_of(write_run(folder / "run", seeds=(1, 2)), "best", "failures")
    search = build_search_report(write_search(folder / "search"))
    (folder / "requirements.yaml").write_text(yaml.safe_dump(SMALL))
    call(requirements, folder / "requirements.yaml", "--out", folder / "checked")
    write_figures(folder / "view.html", "log_" * 40, ["a note " * 30], [go.Figure(), go.Figure()])
    seen = observations()
    curve = check(seen)
    parts = [curves_section([curve.curve], seen), checks_section([curve])]
    curves = write_page(folder / "curves.html", SECTIONS_ALONE, parts, name="curves")
    return {
        "report": report,
        "decision": report.with_name("decision.html"),
        "failures": report.with_name("failures.html"),
        "search": search,
        "requirements": folder / "checked.html",
        "view": folder / "view.html",
        "curves": curves,
    }


def test_nothing_is_wider_than_the_screen_and_tables_end_below_a_row(pages):
    with chromium() as (browser, _):
        tab = browser.new_page(viewport={"width": 400, "height": 900})
        tab.set_default_timeout(1000 * GUARD_S)
        for kind, path in pages.items():
            tab.goto(path.as_uri())
            assert tab.evaluate("document.documentElement.scrollWidth") <= 400, kind
            assert tab.evaluate(WIDER) == [], kind
            assert tab.evaluate(CUT) == [], kind
