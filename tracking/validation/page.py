"""Page of a validation: the decision first, then its evidence."""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import yaml

from lidarplace.base.number_text import percent
from lidarplace.validation.cloud_frames import FATES, MARGIN_M, Overlay
from lidarplace.validation.comparison import BELOW_M, LEAST
from lidarplace.validation.decision import Decision
from lidarplace.validation.shadow import widest_shadow
from lidarplace.validation.simulation import SECTORS
from lidarplace.validation.subsets import SOURCES
from lidarplace.validation.validation import Validation
from tracking.figures.kit.style import OUTLINE, QUIET, colour, figure, legend_below, text
from tracking.labels import DASH, digits
from tracking.pages.html_page import write_page
from tracking.pages.section import Column, Section, Table, numbers, words

_MODELS = {"shipped": "as shipped", "corrected": "corrected"}
_ANSWERS = {
    "yes": "Yes: trust the simulator for this vehicle",
    "with a correction": "Yes, with a correction",
    "no": "No: do not trust the simulator for this vehicle",
}
_WIDE_SHADOW_DEG = 120.0
"""Azimuth that hardly any vehicle shades in one piece: half a turn is a wall next to the LiDAR."""


def write_validation(path: Path, title: str, validation: Validation, decision: Decision) -> Path:
    """Write the page; it needs no network."""
    sections = [
        _overview(validation),
        _by_distance(validation),
        _correction(validation),
        _subsets(validation),
        *([] if validation.shadows is None else [_shadow(validation)]),
        _worst(validation),
    ]
    compared = (
        f"{validation.boxes:,} boxes of {validation.tracks:,} objects in {validation.frames:,} "
        f"frames of {validation.routes} routes, nearer than {BELOW_M:g} m; {validation.clouds:,} "
        f"frames with clouds; {with_world(validation)}; LiDARs {', '.join(validation.names)}."
    )
    return write_page(
        path,
        Path(__file__).with_name("validation.html"),
        sections,
        name=title,
        answer=_ANSWERS[decision.answer],
        why=decision.why,
        warnings=warnings_of(validation),
        next_steps=_next_steps(validation, decision),
        compared=compared,
    )


def with_world(validation: Validation) -> str:
    """Say how many objects had a static world, and which labels are left out."""
    without = f"; left out: {', '.join(validation.without)}" if validation.without else ""
    share = percent(validation.scores.iloc[0]["world"])
    return f"static world for {share} of the objects{without}"


def warnings_of(validation: Validation) -> list[str]:
    """List what makes the numbers doubtful, a sentence each."""
    warnings = []
    rows = () if validation.shadows is None else validation.shadows
    for name, row in zip(validation.names, rows, strict=False):
        if (degrees := widest_shadow(row)) >= _WIDE_SHADOW_DEG:
            warnings.append(
                f"{name}: almost no returns over {degrees:.0f}° of azimuth. A vehicle's body is "
                "rarely so wide: the clouds are probably cropped, as to a camera's view, or the "
                "yaw of the LiDAR is wrong. The correction applies to the rest of its azimuth."
            )
    return warnings


def _percent(share: float) -> str:
    return DASH if math.isnan(share) else percent(share)


SCORES = (
    numbers("objects", "objects", ",.0f"),
    numbers("simulated / real, sums", "ratio", ".2f"),
    numbers("bias, log2", "bias", "+z.2f"),
    numbers("spread, log2", "spread", ".2f"),
    numbers("within a factor 2", "within_2", _percent),
    numbers("ρ", "rho", "z.2f"),
)
"""Columns of `comparison`; bias and spread are medians of the ratio and of its absolute value."""


def _shares(points: int) -> Column:
    """Compare the shares of real and simulated objects with at least so many points."""

    def cell(row: Mapping[Any, Any]) -> str:
        return f"{_percent(row[f'real_{points}'])} / {_percent(row[f'simulated_{points}'])}"

    return Column(f"≥ {points} points, real / sim.", cell)


_SHARES = tuple(map(_shares, LEAST))


def _score_table(validation: Validation, by: str, caption: str) -> Table:
    """Tabulate rows of `comparison`, as shipped and corrected below each other."""
    rows = validation.scores[validation.scores["by"] == by]
    order = {group: place for place, group in enumerate(dict.fromkeys(rows["group"]))}
    rows = rows.sort_values("group", key=lambda groups: groups.map(order), kind="stable")

    def label(row: Mapping[Any, Any]) -> str:
        model = _MODELS[row["model"]]
        return model if by == "all" else f"{row['group']}, {model}"

    return Table.of(caption, rows, [Column("", label, words=True), *SCORES, *_SHARES])


def _overview(validation: Validation) -> Section:
    basis = "Corrected: fitted to all routes but one, evaluated on that one, each route in turn."
    if validation.correction_given:
        basis = "The correction was given; it is evaluated on this log."
    elif validation.routes < 2:
        basis = "There is one route, so a correction cannot be evaluated: corrected is as shipped."
    notes = [
        basis,
        "Bias: median of log2(simulated / real). Spread: median of its absolute value.",
        "The last row compares the real points of an object with those in the frame before: no "
        "simulation of single frames can be closer.",
    ]
    table = _score_table(validation, "all", "All objects")
    cells = (column.cell(validation.floor) for column in SCORES)
    floor = ("one frame against the next", *cells, *("" for _ in _SHARES))
    tables = [
        Table(table.caption, table.head, (*table.rows, floor)),
        _score_table(validation, "class", "By class"),
    ]
    return Section("How close the simulation is", notes, tables=tables)


def _by_distance(validation: Validation) -> Section:
    rows = validation.scores[validation.scores["by"] == "distance"]
    ratio = figure("Simulated / real points, median", 320)
    share = figure("Share of objects with at least 5 points", 320)
    rows = rows.assign(group=rows["group"].str.replace(" to ", "–").str.removesuffix(" m"))
    for number, (model, name) in enumerate(_MODELS.items()):
        scores = rows[rows["model"] == model]
        line = {"name": name, "mode": "lines+markers", "line": {"color": colour(number)}}
        ratio.add_scatter(x=scores["group"], y=2 ** scores["bias"], **line)
        share.add_scatter(x=scores["group"], y=100 * scores["simulated_5"], **line)
    real = rows[rows["model"] == "shipped"]
    line = {"name": "real", "mode": "lines+markers", "line": {"color": OUTLINE, "dash": "dot"}}
    share.add_scatter(x=real["group"], y=100 * real["real_5"], **line)
    ratio.add_hline(y=1.0, line={"color": OUTLINE, "dash": "dot"})
    share.update_yaxes(ticksuffix=" %")
    for plot in (ratio, share):
        legend_below(plot.update_xaxes(title="distance (m)", type="category"))
    tables = [_score_table(validation, by, f"By {by}") for by in ("distance", "route")]
    return Section("By distance and route", [], [ratio, share], tables, columns=2)


def _correction(validation: Validation) -> Section:
    file, rows = validation.correction, []
    for name, value in (file.factor | {"distance": file.distance or math.inf}).items():
        show = _metres if name == "distance" else partial(digits, form=".2f")
        ends = dict.fromkeys(map(show, validation.intervals.get(name, ())))
        rows.append((name, show(value), " to ".join(ends) or DASH))
    head = ("", "value", "95 % interval over objects")
    tables = [Table("The correction", head, tuple(rows)).without_dashes()]
    if len(validation.fits):
        factors = [str(name) for name in validation.fits if name not in ("route", "boxes")]
        columns = [numbers(name, name, ".2f") for name in factors if name != "distance"]
        columns.append(numbers("distance", "distance", _metres))
        route = words("route left out", "route", "{:g}".format)
        tables.append(Table.of("Fitted without one route", validation.fits, [route, *columns]))
    note = (
        "A ray that hits an object returns with probability factor × exp(−range / distance) × the "
        "share that the vehicle's own shadow leaves."
    )
    return Section("The correction", [note], tables=tables)


def _next_steps(validation: Validation, decision: Decision) -> list[dict[str, str]]:
    """Return the step that uses the correction, or that adds what rays cannot go through."""
    if decision.answer == "no" and validation.scores.iloc[0]["world"] < 1.0:
        step = "convert the log with a static world, which stops rays at what nobody labelled"
        return [{"what": step, "line": "lidarplace convert … --clouds … --world"}]
    if decision.answer != "with a correction":
        return []
    lidar = {"name": "…", "correction": "correction.yaml"}
    if validation.correction.lidars:
        lidar["unit"] = next(iter(validation.correction.lidars))
    style: dict[str, Any] = {"sort_keys": False, "allow_unicode": True, "default_flow_style": None}
    line = yaml.safe_dump({"lidar": lidar}, width=200, **style).strip()
    return [{"what": "use it in sweeps, searches, requirements and the studio", "line": line}]


def _metres(value: float) -> str:
    return "none" if math.isinf(value) else f"{value:.0f} m"


def _subsets(validation: Validation) -> Section:
    title = "Subsets of the LiDARs, a placement experiment"
    if len(validation.names) < 2:
        return Section(title, ["The rig has one LiDAR."])
    if not len(validation.subsets):
        return Section(title, ["The LiDAR of each real point is unknown: convert with --clouds."])
    tables = []
    for key, part in validation.subsets.groupby(["measure", "class"], sort=False):
        measure, name = map(str, key)
        form = ".3f" if measure == "expected_recall" else ".1f"
        columns = [numbers(head, source, form) for source, head in _SOURCES.items()]
        label = f"{measure.replace('_', ' ')}, {name}: {part['objects'].iloc[0]:,} objects"
        ranked = part.sort_values("real", ascending=False)
        tables.append(Table.of(label, ranked, [words("subset"), *columns]))
    agreed = "; ".join(
        f"{row['measure'].replace('_', ' ')}, {row['class']}: {digits(row['shipped'], 'z.2f')} as "
        f"shipped, {digits(row['corrected'], 'z.2f')} corrected"
        for _, row in validation.agreement.dropna(subset="corrected").iterrows()
    )
    notes = [
        "Each subset of the rig's LiDARs is a placement whose real points are known. Values are "
        "means over objects.",
        f"Rank correlation with the real order: {agreed}."
        if agreed
        else "With fewer than 3 subsets there is no rank correlation.",
    ]
    return Section(title, notes, tables=tables)


_SOURCES = dict(zip(SOURCES, ("real", "as shipped", "corrected"), strict=True))


def _shadow(validation: Validation) -> Section:
    assert validation.shadows is not None  # checked by the caller
    figures, closed, azimuth = [], [], (np.arange(SECTORS) + 0.5) * 360 / SECTORS - 180
    polar = {
        "angularaxis": {"rotation": 90, "direction": "counterclockwise", "gridcolor": OUTLINE},
        "radialaxis": {"range": [0, 1], "tickvals": [0.5, 1], "gridcolor": OUTLINE},
        "bgcolor": "rgba(0,0,0,0)",
    }
    for number, (name, row) in enumerate(zip(validation.names, validation.shadows, strict=True)):
        plot = figure(f"{text(name)}: share of returns", 340, {"t": 75, "b": 30}, polar=polar)
        bars = {"width": 360 / SECTORS, "marker_color": colour(number), "showlegend": False}
        figures.append(plot.add_barpolar(theta=azimuth, r=row, **bars))
        closed.append(f"{name} {percent((row < 1).mean())}")
    note = (
        "Returns of each azimuth sector compared with open sectors, in the frame of the LiDAR "
        f"(0° is its x axis). In shadow: {', '.join(closed)} of the azimuth."
    )
    return Section("The vehicle's own shadow", [note], figures)


def _worst(validation: Validation) -> Section:
    columns = [
        words("object", "object_id", lambda name: str(name)[:13]),
        words("class"),
        numbers("m", "distance", ".0f"),
        words("frame"),
        *(numbers(head, source, ",.0f") for source, head in _SOURCES.items()),
        *(numbers(fate, fate, ",.0f") for fate in FATES),
        words("reason"),
    ]
    notes = [
        "Simulated rays that hit the object, by the real return in that direction: in its box, "
        "hidden by something nearer without a label, passed beyond the box, or lost."
    ]
    if not validation.clouds:
        notes = ["Without clouds the reason is unknown: convert with --clouds."]
    elif validation.overlays:
        notes.append(
            "Figures: real points around the box of each, and the simulated ones, as shipped; from "
            "above and from the side. The arrow points to the vehicle."
        )
    pairs = zip(validation.overlays, validation.worst.to_dict("records"), strict=False)
    figures = [_overlay(overlay, row) for overlay, row in pairs]
    table = Table.of("Largest differences after the correction", validation.worst, columns)
    return Section("Worst objects", notes, figures, [table])


def _overlay(overlay: Overlay, row: Mapping[Any, Any]) -> go.Figure:
    """Draw the points of an object in the axes of its box, from above and from the side."""
    name, reason = str(row["object_id"])[:13], f": {row['reason']}" if row["reason"] else ""
    title = text(f"{row['class']} {name}, {row['distance']:.0f} m{reason}")
    counts = f"{row['real']:,.0f} real points, {row['shipped']:,.0f} simulated"
    plot = figure(f"{title}<br>{counts}", 520, {"t": 66})
    clouds = {"real": (overlay.real, "circle"), "simulated": (overlay.simulated, "circle-open")}
    reach = overlay.size / 2 + MARGIN_M
    for up, axis in ((1, "y"), (2, "y2")):
        corner = overlay.size[[0, up]] / 2 * [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]
        line = {"mode": "lines", "line": {"color": OUTLINE}, **QUIET}
        plot.add_scatter(x=corner[:, 0], y=corner[:, 1], yaxis=axis, **line)
        for number, (name, (points, symbol)) in enumerate(clouds.items()):
            marker = {"size": 5, "symbol": symbol, "color": colour(number)}
            style = {"mode": "markers", "marker": marker, "hoverinfo": "skip", "name": name}
            group = {"legendgroup": name, "showlegend": up == 1}
            plot.add_scatter(x=points[:, 0], y=points[:, up], yaxis=axis, **style, **group)
    away = overlay.origin[:2] / max(float(np.hypot(*overlay.origin[:2])), 1e-9)
    start, end = (away * (np.hypot(*overlay.size[:2]) / 2 + length) for length in (0.0, 0.6))
    plot.add_annotation(
        dict(zip(("ax", "ay", "x", "y"), (*start, *end), strict=True)),
        axref="x", ayref="y", xref="x", yref="y", arrowhead=2, arrowcolor=OUTLINE, text="",
    )  # fmt: skip
    alike = {"scaleanchor": "x", "constrain": "domain"}
    return legend_below(plot).update_layout(
        xaxis={"title": "along the box (m)", "range": [-reach[0], reach[0]], "anchor": "y2"},
        yaxis={"title": "left", "range": [-reach[1], reach[1]], "domain": [0.52, 1], **alike},
        yaxis2={"title": "up", "range": [-reach[2], reach[2]], "domain": [0, 0.45], **alike},
    )
