"""The page of a validation: the decision first, then what it rests on."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import numpy as np
import plotly.graph_objects as go
import yaml
from plotly.offline import get_plotlyjs

from lidarplace.files.atomic import write_text
from lidarplace.validation.cloud_frames import FATES
from lidarplace.validation.comparison import BELOW_M, LEAST
from lidarplace.validation.decision import Decision
from lidarplace.validation.simulation import SECTORS
from lidarplace.validation.subsets import SOURCES
from lidarplace.validation.validation import Validation
from lidarplace.viewing.page import as_json
from lidarplace.viewing.style import COLOURS, OUTLINE, theme

_MODELS = {"shipped": "as shipped", "corrected": "corrected"}
_ANSWERS = {
    "yes": "Yes: believe the simulator for this vehicle",
    "with a correction": "Yes, with a correction",
    "no": "No: do not believe the simulator for this vehicle",
}


class PageTable(NamedTuple):
    """Table of the page; the first column holds words."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


class PageSection(NamedTuple):
    """A part of the page."""

    title: str
    notes: Sequence[str] = ()
    figures: Sequence[str] = ()
    tables: Sequence[PageTable] = ()
    code: str = ""


def write_page(path: Path, title: str, validation: Validation, decision: Decision) -> None:
    """Write the page; it needs no network."""
    template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    options: dict[str, Any] = {"autoescape": True, "trim_blocks": True, "lstrip_blocks": True}
    sections = [
        _overview(validation),
        _by_distance(validation),
        _correction(validation),
        _subsets(validation),
    ]
    if validation.shadows is not None:
        sections.append(_shadow(validation))
    sections.append(_worst(validation))
    page = jinja2.Template(template, undefined=jinja2.StrictUndefined, **options).render(
        title=title,
        answer=_ANSWERS[decision.answer],
        kind=decision.answer.split()[0],
        why=decision.why,
        compared=f"{validation.boxes:,} boxes of {validation.tracks:,} objects in "
        f"{validation.frames:,} frames of {validation.routes} routes, nearer than {BELOW_M:g} m; "
        f"{validation.clouds:,} frames with clouds; {with_world(validation)}; LiDARs "
        f"{', '.join(validation.names)}.",
        sections=sections,
        plotlyjs=get_plotlyjs(),
        themes=json.dumps({"light": theme(False), "dark": theme(True)}),
    )
    write_text(path, page)


def with_world(validation: Validation) -> str:
    """Say how many objects had a static world, and which labels are left out."""
    without = f"; left out: {', '.join(validation.without)}" if validation.without else ""
    return f"static world for {validation.scores.iloc[0]['world']:.0%} of the objects{without}"


_SCORES: dict[str, tuple[str, Callable[[float], str]]] = {
    "objects": ("objects", lambda value: f"{value:,.0f}"),
    "ratio": ("simulated / real, sums", lambda value: f"{value:.2f}"),
    "bias": ("median log2 ratio", lambda value: f"{round(value, 2) + 0.0:+.2f}"),
    "spread": ("median |log2 ratio|", lambda value: f"{value:.2f}"),
    "within_2": ("within a factor 2", lambda value: f"{value:.0%}"),
    "rho": ("rho", lambda value: f"{value:.2f}"),
}


def _score_table(validation: Validation, by: str, caption: str) -> PageTable:
    """Tabulate rows of `comparison`, as shipped and corrected below each other."""
    rows, lines = validation.scores[validation.scores["by"] == by], []
    for group in dict.fromkeys(rows["group"]):
        for model, name in _MODELS.items():
            row = rows[(rows["group"] == group) & (rows["model"] == model)].iloc[0]
            label = name if by == "all" else f"{group}, {name}"
            shares = (f"{row[f'real_{n}']:.0%} / {row[f'simulated_{n}']:.0%}" for n in LEAST)
            lines.append([label, *_cells(row), *shares])
    head = ["", *(words for words, _ in _SCORES.values())]
    return PageTable(caption, [*head, *(f"≥ {n} points, real / sim." for n in LEAST)], lines)


def _cells(scores: Mapping[Any, float]) -> list[str]:
    return [_cell(scores[key], show) for key, (_, show) in _SCORES.items()]


def _cell(value: float, show: Callable[[float], str]) -> str:
    return "" if math.isnan(value) else show(value)


def _overview(validation: Validation) -> PageSection:
    table = _score_table(validation, "all", "All objects")
    floor = ["one frame against the next", *_cells(validation.floor), "", ""]
    judged = "Corrected: fitted to all routes but one, judged on that one, each route in turn."
    if validation.correction_given:
        judged = "The correction was given; it is judged on this log."
    elif validation.routes < 2:
        judged = "There is one route, so no correction can be judged: corrected is as shipped."
    notes = [
        judged,
        "The last row compares the real points of an object with those in the frame before: no "
        "simulation of single frames can be closer.",
    ]
    tables = (
        table._replace(rows=[*table.rows, floor]),
        _score_table(validation, "class", "By class"),
    )
    return PageSection("How close the simulation is", notes, tables=tables)


def _by_distance(validation: Validation) -> PageSection:
    rows = validation.scores[validation.scores["by"] == "distance"]
    ratio = _figure("Simulated / real points, median")
    share = _figure("Share of objects with at least 5 points")
    rows = rows.assign(group=rows["group"].str.replace(" to ", "–").str.removesuffix(" m"))
    for number, (model, name) in enumerate(_MODELS.items()):
        scores = rows[rows["model"] == model]
        line = {"name": name, "mode": "lines+markers", "line": {"color": COLOURS[number]}}
        ratio.add_scatter(x=scores["group"], y=2 ** scores["bias"], **line)
        share.add_scatter(x=scores["group"], y=scores["simulated_5"], **line)
    real = rows[rows["model"] == "shipped"]
    line = {"name": "real", "mode": "lines+markers", "line": {"color": OUTLINE, "dash": "dot"}}
    share.add_scatter(x=real["group"], y=real["real_5"], **line)
    ratio.add_hline(y=1.0, line={"color": OUTLINE, "dash": "dot"})
    share.update_yaxes(tickformat=".0%")
    figures = [as_json(f.update_xaxes(title="metres", type="category")) for f in (ratio, share)]
    tables = [_score_table(validation, by, f"By {by}") for by in ("distance", "route")]
    return PageSection("By distance and route", (), figures, tables)


def _correction(validation: Validation) -> PageSection:
    file, rows = validation.correction, []
    for name, value in (file.factor | {"distance": file.distance or math.inf}).items():
        show: Callable[[float], str] = _metres if name == "distance" else "{:.3f}".format
        ends = " to ".join(map(show, validation.intervals.get(name, ())))
        rows.append([name, show(value), ends])
    tables = [PageTable("The correction", ("", "value", "95 % interval over objects"), rows)]
    if len(validation.fits):
        names = [str(name) for name in validation.fits if name not in ("route", "boxes")]
        shows: dict[str, Callable[[float], str]] = dict.fromkeys(names, "{:.3f}".format)
        shows = {"route": "{:g}".format} | shows | {"distance": _metres}
        fits = validation.fits[[*shows]].to_dict("records")
        fitted = [[_cell(row[name], shows[name]) for name in shows] for row in fits]
        tables.append(PageTable("Fitted without one route", ("route left out", *names), fitted))
    use = {"name": "…", "correction": "correction.yaml"}
    if file.lidars:
        use["unit"] = next(iter(file.lidars))
    note = (
        "A ray on an object returns with probability factor × exp(−range / distance) × share that "
        "the own shadow leaves. Sweeps, searches, requirements and the studio take it so:"
    )
    code = yaml.safe_dump({"lidar": use}, sort_keys=False, allow_unicode=True)
    return PageSection("The correction", (note,), (), tables, code)


def _metres(value: float) -> str:
    return "none" if math.isinf(value) else f"{value:.0f} m"


def _subsets(validation: Validation) -> PageSection:
    if len(validation.names) < 2:
        return PageSection("Subsets of the LiDARs", ("The rig has one LiDAR.",))
    if not len(validation.subsets):
        why = "Real points are not known by LiDAR: convert with --clouds."
        return PageSection("Subsets of the LiDARs", (why,))
    tables = []
    for key, part in validation.subsets.groupby(["measure", "class"], sort=False):
        measure, name = map(str, key)
        show = f"{{:.{3 if measure == 'expected_recall' else 1}f}}".format
        ranked = part.sort_values("real", ascending=False)
        rows = [
            [row["subset"], *(show(row[source]) for source in SOURCES)]
            for _, row in ranked.iterrows()
        ]
        label = f"{measure.replace('_', ' ')}, {name}: {ranked['objects'].iloc[0]:,} objects"
        tables.append(PageTable(label, ("", "real", "as shipped", "corrected"), rows))
    agreed = "; ".join(
        f"{row['measure'].replace('_', ' ')}, {row['class']}: {row['shipped']:.2f} as shipped, "
        f"{row['corrected']:.2f} corrected"
        for _, row in validation.agreement.dropna(subset="corrected").iterrows()
    )
    notes = [
        "Each subset of the rig's LiDARs is a placement whose real points are known. Values are "
        "means over objects.",
        f"Rank correlation with the real order: {agreed}."
        if agreed
        else "With fewer than 3 subsets there is no rank correlation.",
    ]
    return PageSection("Subsets of the LiDARs, a placement experiment", notes, (), tables)


def _shadow(validation: Validation) -> PageSection:
    assert validation.shadows is not None  # asked by the caller
    figures, closed, azimuth = [], [], (np.arange(SECTORS) + 0.5) * 360 / SECTORS - 180
    polar = {
        "angularaxis": {"rotation": 90, "direction": "counterclockwise"},
        "radialaxis": {"range": [0, 1], "tickvals": [0.5, 1]},
        "bgcolor": "rgba(0,0,0,0)",
    }
    for number, (name, row) in enumerate(zip(validation.names, validation.shadows, strict=True)):
        figure, colour = _figure(f"{name}: share of returns"), COLOURS[number % len(COLOURS)]
        bars = {"width": 360 / SECTORS, "marker_color": colour, "showlegend": False}
        figure.add_barpolar(theta=azimuth, r=row, **bars)
        figures.append(as_json(figure.update_layout(margin={"t": 75}, polar=polar)))
        closed.append(f"{name} {(row < 1).mean():.0%}")
    note = (
        "Returns of each azimuth sector compared with open sectors, in the frame of the LiDAR "
        f"(0° is its x axis). In shadow: {', '.join(closed)} of the azimuth."
    )
    return PageSection("The vehicle's own shadow", (note,), figures)


def _worst(validation: Validation) -> PageSection:
    rows = [
        [
            str(row["object_id"])[:13], str(row["class"]), f"{row['distance']:.0f}",
            str(row["frame"]), *(f"{row[source]:.0f}" for source in SOURCES),
            *(_cell(row[fate], "{:.0f}".format) for fate in FATES), str(row["reason"]),
        ]
        for _, row in validation.worst.iterrows()
    ]  # fmt: skip
    head = ("object", "class", "m", "frame", "real", "as shipped", "corrected", *FATES, "reason")
    note = (
        "Simulated rays that meet the object, by the real return in that direction: in its box, "
        "hidden by something nearer without a label, passed beyond the box, or lost."
    )
    if not validation.clouds:
        note = "Without clouds the reason is not known: convert with --clouds."
    table = PageTable("Farthest off after the correction", head, rows)
    return PageSection("Worst objects", (note,), tables=(table,))


def _figure(title: str) -> go.Figure:
    layout = {"margin": {"l": 45, "r": 15, "t": 40, "b": 40}, "height": 320}
    layout |= {"legend": {"orientation": "h", "y": -0.3}}
    return go.Figure(layout=layout | {"title": {"text": title, "font": {"size": 14}}})
