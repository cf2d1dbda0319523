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
from lidarplace.validation.simulation import SECTORS
from lidarplace.validation.subsets import WHAT
from lidarplace.validation.validation import Validation
from lidarplace.validation.verdict import Verdict
from lidarplace.viewing.page import as_json
from lidarplace.viewing.style import COLOURS, OUTLINE, theme

_MODELS = {"shipped": "as shipped", "corrected": "corrected"}
_ANSWERS = {
    "yes": "Yes: believe the simulator for this vehicle",
    "with a correction": "Yes, with a correction",
    "no": "No: do not believe the simulator for this vehicle",
}


class Table(NamedTuple):
    """Table of the page; the first column holds words."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


class Section(NamedTuple):
    """A part of the page."""

    title: str
    notes: Sequence[str] = ()
    figures: Sequence[str] = ()
    tables: Sequence[Table] = ()
    code: str = ""


def write_page(path: Path, title: str, found: Validation, decision: Verdict) -> None:
    """Write the page; it needs no network."""
    template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    options: dict[str, Any] = {"autoescape": True, "trim_blocks": True, "lstrip_blocks": True}
    sections = [_overview(found), _by_distance(found), _correction(found), _subsets(found)]
    if found.shadows is not None:
        sections.append(_shadow(found))
    sections.append(_worst(found))
    page = jinja2.Template(template, undefined=jinja2.StrictUndefined, **options).render(
        title=title,
        answer=_ANSWERS[decision.answer],
        kind=decision.answer.split()[0],
        why=decision.why,
        compared=f"{found.boxes:,} boxes of {found.tracks:,} objects in {found.frames:,} frames of "
        f"{found.routes} routes, nearer than {BELOW_M:g} m; {found.clouds:,} frames with clouds; "
        f"{with_world(found)}; LiDARs {', '.join(found.names)}.",
        sections=sections,
        plotlyjs=get_plotlyjs(),
        themes=json.dumps({"light": theme(False), "dark": theme(True)}),
    )
    write_text(path, page)


def with_world(found: Validation) -> str:
    """Say how many objects had a static world, and which labels are left out."""
    without = f"; left out: {', '.join(found.without)}" if found.without else ""
    return f"static world for {found.scores.iloc[0]['world']:.0%} of the objects{without}"


_SCORES: dict[str, tuple[str, Callable[[float], str]]] = {
    "objects": ("objects", lambda value: f"{value:,.0f}"),
    "ratio": ("simulated / real, sums", lambda value: f"{value:.2f}"),
    "bias": ("median log2 ratio", lambda value: f"{round(value, 2) + 0.0:+.2f}"),
    "spread": ("median |log2 ratio|", lambda value: f"{value:.2f}"),
    "within_2": ("within a factor 2", lambda value: f"{value:.0%}"),
    "rho": ("rho", lambda value: f"{value:.2f}"),
}


def _score_table(found: Validation, by: str, caption: str) -> Table:
    """Tabulate rows of `comparison`, as shipped and corrected below each other."""
    rows, shown = found.scores[found.scores["by"] == by], []
    for group in dict.fromkeys(rows["group"]):
        for model, name in _MODELS.items():
            row = rows[(rows["group"] == group) & (rows["model"] == model)].iloc[0]
            label = name if by == "all" else f"{group}, {name}"
            shares = (f"{row[f'real_{n}']:.0%} / {row[f'simulated_{n}']:.0%}" for n in LEAST)
            shown.append([label, *_cells(row), *shares])
    head = ["", *(words for words, _ in _SCORES.values())]
    return Table(caption, [*head, *(f"≥ {n} points, real / sim." for n in LEAST)], shown)


def _cells(scores: Mapping[Any, float]) -> list[str]:
    return [_cell(scores[key], show) for key, (_, show) in _SCORES.items()]


def _cell(value: float, show: Callable[[float], str]) -> str:
    return "" if math.isnan(value) else show(value)


def _overview(found: Validation) -> Section:
    table = _score_table(found, "all", "All objects")
    floor = ["one frame against the next", *_cells(found.floor), "", ""]
    judged = "Corrected: fitted to all routes but one, judged on that one, each route in turn."
    if found.given:
        judged = "The correction was given; it is judged on this log."
    elif found.routes < 2:
        judged = "There is one route, so no correction can be judged: corrected is as shipped."
    notes = [
        judged,
        "The last row compares the real points of an object with those in the frame before: no "
        "simulation of single frames can be closer.",
    ]
    tables = (table._replace(rows=[*table.rows, floor]), _score_table(found, "class", "By class"))
    return Section("How close the simulation is", notes, tables=tables)


def _by_distance(found: Validation) -> Section:
    rows = found.scores[found.scores["by"] == "distance"]
    ratio = _figure("Simulated / real points, median")
    share = _figure("Share of objects with at least 5 points")
    rows = rows.assign(group=rows["group"].str.replace(" to ", "–").str.removesuffix(" m"))
    for number, (model, name) in enumerate(_MODELS.items()):
        own = rows[rows["model"] == model]
        line = {"name": name, "mode": "lines+markers", "line": {"color": COLOURS[number]}}
        ratio.add_scatter(x=own["group"], y=2 ** own["bias"], **line)
        share.add_scatter(x=own["group"], y=own["simulated_5"], **line)
    real = rows[rows["model"] == "shipped"]
    line = {"name": "real", "mode": "lines+markers", "line": {"color": OUTLINE, "dash": "dot"}}
    share.add_scatter(x=real["group"], y=real["real_5"], **line)
    ratio.add_hline(y=1.0, line={"color": OUTLINE, "dash": "dot"})
    share.update_yaxes(tickformat=".0%")
    figures = [as_json(own.update_xaxes(title="metres", type="category")) for own in (ratio, share)]
    tables = [_score_table(found, by, f"By {by}") for by in ("distance", "route")]
    return Section("By distance and route", (), figures, tables)


def _correction(found: Validation) -> Section:
    file, rows = found.correction, []
    for name, value in (file.factor | {"distance": file.distance or math.inf}).items():
        show: Callable[[float], str] = _metres if name == "distance" else "{:.3f}".format
        ends = " to ".join(map(show, found.intervals.get(name, ())))
        rows.append([name, show(value), ends])
    tables = [Table("The correction", ("", "value", "95 % interval over objects"), rows)]
    if len(found.fits):
        names = [str(name) for name in found.fits if name not in ("route", "boxes")]
        shows: dict[str, Callable[[float], str]] = dict.fromkeys(names, "{:.3f}".format)
        shows = {"route": "{:g}".format} | shows | {"distance": _metres}
        fits = found.fits[[*shows]].to_dict("records")
        fitted = [[_cell(row[name], shows[name]) for name in shows] for row in fits]
        tables.append(Table("Fitted without one route", ("route left out", *names), fitted))
    use = {"name": "…", "correction": "correction.yaml"}
    if file.lidars:
        use["unit"] = next(iter(file.lidars))
    note = (
        "A ray on an object returns with probability factor × exp(−range / distance) × share that "
        "the own shadow leaves. Sweeps, searches, requirements and the studio take it so:"
    )
    code = yaml.safe_dump({"lidar": use}, sort_keys=False, allow_unicode=True)
    return Section("The correction", (note,), (), tables, code)


def _metres(value: float) -> str:
    return "none" if math.isinf(value) else f"{value:.0f} m"


def _subsets(found: Validation) -> Section:
    if len(found.names) < 2:
        return Section("Subsets of the LiDARs", ("The rig has one LiDAR.",))
    if not len(found.subsets):
        why = "Real points are not known by LiDAR: convert with --clouds."
        return Section("Subsets of the LiDARs", (why,))
    tables = []
    for key, part in found.subsets.groupby(["measure", "class"], sort=False):
        measure, name = map(str, key)
        show = f"{{:.{3 if measure == 'expected_recall' else 1}f}}".format
        ranked = part.sort_values("real", ascending=False)
        rows = [[row["subset"], *(show(row[w]) for w in WHAT)] for _, row in ranked.iterrows()]
        label = f"{measure.replace('_', ' ')}, {name}: {ranked['objects'].iloc[0]:,} objects"
        tables.append(Table(label, ("", "real", "as shipped", "corrected"), rows))
    agreed = "; ".join(
        f"{row['measure'].replace('_', ' ')}, {row['class']}: {row['shipped']:.2f} as shipped, "
        f"{row['corrected']:.2f} corrected"
        for _, row in found.agreement.dropna(subset="corrected").iterrows()
    )
    notes = [
        "Each subset of the rig's LiDARs is a placement whose real points are known. Values are "
        "means over objects.",
        f"Rank correlation with the real order: {agreed}."
        if agreed
        else "With fewer than 3 subsets there is no rank correlation.",
    ]
    return Section("Subsets of the LiDARs, a placement experiment", notes, (), tables)


def _shadow(found: Validation) -> Section:
    assert found.shadows is not None  # asked by the caller
    figures, closed, middle = [], [], (np.arange(SECTORS) + 0.5) * 360 / SECTORS - 180
    polar = {
        "angularaxis": {"rotation": 90, "direction": "counterclockwise"},
        "radialaxis": {"range": [0, 1], "tickvals": [0.5, 1]},
        "bgcolor": "rgba(0,0,0,0)",
    }
    for number, (name, row) in enumerate(zip(found.names, found.shadows, strict=True)):
        figure, colour = _figure(f"{name}: share of returns"), COLOURS[number % len(COLOURS)]
        bars = {"width": 360 / SECTORS, "marker_color": colour, "showlegend": False}
        figure.add_barpolar(theta=middle, r=row, **bars)
        figures.append(as_json(figure.update_layout(margin={"t": 75}, polar=polar)))
        closed.append(f"{name} {(row < 1).mean():.0%}")
    note = (
        "Returns of each azimuth sector compared with open sectors, in the frame of the LiDAR "
        f"(0° is its x axis). In shadow: {', '.join(closed)} of the azimuth."
    )
    return Section("The vehicle's own shadow", (note,), figures)


def _worst(found: Validation) -> Section:
    rows = [
        [
            str(row["object_id"])[:13], str(row["class"]), f"{row['distance']:.0f}",
            str(row["frame"]), *(f"{row[what]:.0f}" for what in ("real", "shipped", "corrected")),
            *(_cell(row[fate], "{:.0f}".format) for fate in FATES), str(row["reason"]),
        ]
        for _, row in found.worst.iterrows()
    ]  # fmt: skip
    head = ("object", "class", "m", "frame", "real", "as shipped", "corrected", *FATES, "reason")
    note = (
        "Simulated rays that meet the object, by the real return in that direction: in its box, "
        "hidden by something nearer without a label, passed beyond the box, or lost."
    )
    if not found.clouds:
        note = "Without clouds the reason is not known: convert with --clouds."
    table = Table("Farthest off after the correction", head, rows)
    return Section("Worst objects", (note,), tables=(table,))


def _figure(title: str) -> go.Figure:
    layout = {"margin": {"l": 45, "r": 15, "t": 40, "b": 40}, "height": 320}
    layout |= {"legend": {"orientation": "h", "y": -0.3}}
    return go.Figure(layout=layout | {"title": {"text": title, "font": {"size": 14}}})
