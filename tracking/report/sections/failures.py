"""Objects that one rig finds and another one misses."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from lidarplace.base.metrics import kitti_iou
from tracking.figures.kit.style import OUTLINE, colour, figure, legend_below, name_rows, text
from tracking.findings.failures import DIMENSIONS, Failures
from tracking.findings.groups import has_detectors
from tracking.labels import points, span
from tracking.pages.section import Column, Section, Table, numbers, words
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label

FILE = "failures.html"  # of `tracking.report.failures`, in the folder of the run
TITLE = "What one rig finds and another one misses"
_FEW = 100  # objects in a bin, below which it is not named


def failures_section(analysis: Analysis) -> Section | None:
    """Count the failures of the best rig and the next one; None for a sweep without detectors."""
    run = analysis.run
    if analysis.pair is not None:
        return counted_failures(analysis.pair)
    if not has_detectors(run) or (run.objects is not None and run.found is not None):
        return None
    missing = [f"{name}.parquet" for name in ("objects", "found") if getattr(run, name) is None]
    note = (
        f"The run folder has no {' and no '.join(missing)}. The command of the sweep writes them; "
        "results that are in the store are not computed again."
    )
    return Section(TITLE, notes=[note])


def counted_failures(failures: Failures) -> Section:
    """Count the objects that each rig finds alone; the first two notes summarise it."""
    counts = failures.counts()
    ious = ", ".join(f"{name} {kitti_iou(name).strict:g}" for name in failures.classes)
    link = f"The frames with the largest differences, under {' and '.join(failures.rigs)}"
    section = Section(TITLE, columns=2, links={FILE: link})
    section.notes = [
        *sentences(failures, counts),
        "Each object of each test frame counts, found at KITTI's strict IoU of its class "
        f"({ious}). Numbers are means over the seeds, of which the same one is compared "
        "under both rigs. Occlusion is KITTI's three levels, by the share of the object that an "
        "ideal sensor above the middle sees; height is that of the object. Intervals are for each "
        "row by itself, over seeds and over which routes and individuals the frames met; the "
        "largest of many differences is partly chance.",
    ]
    for by in DIMENSIONS:
        of_dimension = counts[counts["by"] == by]
        title, bins = f"Found by one rig alone, by {by}", of_dimension["bin"].unique().tolist()
        of_dimension = of_dimension[of_dimension["class"] != "all"]
        section.figures.append(
            found_alone(of_dimension, failures.rigs, title, bins, failures.classes)
        )
    section.tables = [_table(failures, counts)]
    return section


def sentences(failures: Failures, counts: pd.DataFrame) -> list[str]:
    """Say how many objects each rig finds alone, and where the first one leads and lags most."""
    first, second = failures.rigs
    whole = counts.iloc[0]
    seeds = f"{len(failures.seeds)} seed{'s' * (len(failures.seeds) != 1)}"
    summary = (
        f"Of {whole['objects']:,} objects ({whole['individuals']:,} individuals) {first} finds "
        f"{whole['first']:,.0f} that {second} misses, and {second} {whole['second']:,.0f} that "
        f"{first} misses; both find {whole['both']:,.0f}, neither {whole['neither']:,.0f} "
        f"({seeds})."
    )
    return [summary, _where(failures, counts)]


def _where(failures: Failures, counts: pd.DataFrame) -> str:
    """Say where the first rig is ahead and behind most, as far as that is significant."""
    if counts["low"].isna().all():
        return "The uncertainty is unknown: one seed, or too few road users."
    bins = counts[(counts["by"] != "") & (counts["objects"] >= _FEW)]
    if len(failures.classes) > 1:
        bins = bins[bins["class"] != "all"]
    ahead = bins[bins["low"] > 0].nlargest(1, "difference")
    behind = bins[bins["high"] < 0].nsmallest(1, "difference")
    places = [
        f"{word} most at {_place(row)}"
        for word, rows in (("ahead", ahead), ("behind", behind))
        for row in rows.to_dict("records")
    ]
    if not places:
        return f"In no group of {_FEW} objects or more do the two differ significantly."
    return f"{failures.rigs[0]} is {', and '.join(places)}."


def _place(row: Mapping[Any, Any]) -> str:
    return (
        f"{row['class']}, {row['bin']}: {points(row['difference'])} points "
        f"(95 %: {span(row['low'], row['high'], '+z.1f')})"
    )


def _table(failures: Failures, counts: pd.DataFrame) -> Table:
    first, second = failures.rigs
    columns = [
        words("class", show=class_label),
        Column("which", lambda row: f"{row['by']}: {row['bin']}" if row["by"] else "", words=True),
        numbers("objects", "objects", ","),
        numbers("individuals", "individuals", ","),
        numbers("both", "both", ",.0f"),
        numbers(f"{first} alone", "first", ",.0f"),
        numbers(f"{second} alone", "second", ",.0f"),
        numbers("neither", "neither", ",.0f"),
        numbers("difference", "difference", points),
        Column("95 %", lambda row: span(row["low"], row["high"], "+z.1f")),
    ]
    data = counts.rename(columns={"first": f"{first} alone", "second": f"{second} alone"})
    return Table.of(
        f"Objects found by {first} and by {second}; difference in points of recall",
        counts,
        columns,
        units=dict.fromkeys(("difference", "low", "high"), "points"),
        name="failures",
        data=data,
    )


def found_alone(
    counts: pd.DataFrame, rigs: tuple[str, str], title: str, bins: list[str], classes: Sequence[str]
) -> go.Figure:
    """Draw bars to the right for the first rig, to the left for the second one, a colour a class.

    `counts` are of single classes of one dimension, `bins` are rows from top to bottom, `classes`
    those of the sweep, in order."""
    total = counts.groupby("bin")["objects"].sum()
    plot = figure(title, height=130 + 34 * len(bins), barmode="relative", bargap=0.3)
    for name in classes:
        of_class = counts[counts["class"] == name].set_index("bin")[["first", "second", "objects"]]
        of_class = of_class.reindex(bins, fill_value=0)
        for rig, key, sign in zip(rigs, ("first", "second"), (1, -1), strict=True):
            plot.add_bar(
                x=sign * of_class[key].to_numpy(),
                y=list(range(len(bins))),
                orientation="h",
                marker={"color": colour(classes.index(name))},
                name=text(name),
                legendgroup=name,
                showlegend=sign > 0,
                customdata=of_class[[key, "objects"]].to_numpy(),
                hovertemplate=f"{text(rig)} alone: %{{customdata[0]:.1f}} of "
                f"%{{customdata[1]:,}}<extra>{text(name)}</extra>",
            )
    most = 1.08 * max(counts.groupby("bin")[["first", "second"]].sum().max().max(), 1.0)
    plot.add_vline(x=0, line={"color": OUTLINE, "width": 1})
    unit = 10.0 ** np.floor(np.log10(most / 2))
    step = max(1.0, *(n * unit for n in (1, 2, 5) if n * unit <= most / 2))
    ticks = step * np.arange(-(most // step), most // step + 1)
    plot.update_xaxes(
        title=f"objects: ← {text(rigs[1])} alone<br>{text(rigs[0])} alone →",
        range=[-most, most],
        tickvals=ticks,
        ticktext=[f"{abs(tick):,.0f}" for tick in ticks],
    )
    name_rows(plot, [f"{name}, n {total[name]:,}" for name in bins])
    return legend_below(plot)
