"""Objects: how many there are, and a metric of each placement by where they are."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.metrics import HEADLINE_METRIC, headline_metric
from tracking.figures.kit.vehicle_lines import name_of
from tracking.findings.groups import Group, by_setting, has_detectors
from tracking.findings.individuals import MOST_FREQUENT, count_individuals
from tracking.findings.summary import seed_means
from tracking.kitti_iou import at_headline_iou
from tracking.labels import DASH, digits, metric_label, plus_minus
from tracking.pages.section import Section, Table, numbers, slug, words
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder


def individuals_section(analysis: Analysis) -> Section | None:
    """Count the individuals that were met; None for a sweep without detectors."""
    run = analysis.run
    if not has_detectors(run):
        return None
    title = "Objects: boxes and individuals"
    if run.individuals is None or run.individuals.empty:
        return Section(title, ["The run folder has no individuals.parquet."])
    note = (
        "A box is an object in one frame; a road user in 50 frames is one individual, also over "
        "two routes. Frames of one individual are nearly the same, so the certainty depends on "
        "the number of individuals and routes, not of boxes. A log that does not name its "
        "objects has as many individuals as boxes."
    )
    parts = by_setting(run.individuals, run.axes)
    return Section(
        title, [note], tables=[_individuals_table(part, setting) for setting, part in parts]
    )


def _individuals_table(individuals: pd.DataFrame, title: str) -> Table:
    most = f"boxes of the {MOST_FREQUENT} most frequent"
    columns = [
        words("frames", "split", lambda split: "training" if split == "train" else str(split)),
        words("class"),
        numbers("routes with any", "routes", ","),
        numbers("boxes", "boxes", ","),
        numbers("individuals", "individuals", ","),
        numbers(most, "share_of_ten", lambda share: f"{100 * share:.0f} %"),
    ]
    caption = "Objects that count" + (f" · {title}" if title else "")
    name = slug("individuals", title)
    return Table.of(caption, count_individuals(individuals), columns, name=name)


_METRIC = headline_metric("all")
SECTOR = ["sector", "from_deg", "to_deg"]  # columns that distinguish sectors
RING = ["from_m", "to_m"]  # columns that distinguish rings


@dataclass(frozen=True)
class Bins:
    """Dimension that distinguishes objects, the names of its bins in order, and their unit."""

    of: str
    names: tuple[str, ...]
    unit: str = ""


def means_by_bin(
    run: RunFolder, groups: list[Group], table: pd.DataFrame, keys: list[str], metric: str
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield title and means over seeds of a metric at its headline IoU, for every group and class.

    `keys` are the columns of `table` that distinguish bins."""
    for group in groups:
        for name in run.classes:
            of_class = at_headline_iou(group.of(table), run.results, name, metric)
            if of_class.empty:
                continue
            means = seed_means(of_class.assign(difficulty="all"), [*run.axes, *keys])
            yield group.label(name), means


def wide(rows: pd.DataFrame, bins: Bins, values: str) -> pd.DataFrame:
    """Pivot a table to placements in their order as rows and bins as columns."""
    table = rows.pivot(index="placement", columns="bin", values=values)
    return table.reindex(index=rows["placement"].unique(), columns=bins.names)


def _by_bin(
    rows: pd.DataFrame,
    bins: Bins,
    values: tuple[str, str],
    cell: Callable[..., str],
    **further: Any,
) -> Table:
    """Make a table with a row a placement, a column a bin, cells of two columns of `rows`.

    `further` are attributes of the table."""
    one, two = (wide(rows, bins, name) for name in values)
    cells = tuple((str(name), *map(cell, one.loc[name], two.loc[name])) for name in one.index)
    head = ("placement", *(f"{name}{bins.unit}" for name in bins.names))
    return Table(head=head, rows=cells, **further)


def _metric_table(rows: pd.DataFrame, bins: Bins, measure: str, by: str, label: str) -> Table:
    """Show mean ± sd of every placement and bin of `means_by_bin`, the highest of a bin bold."""
    metric = f"{metric_label(rows['metric'].iloc[0], rows['iou'].iloc[0])} (%)"
    best = frozenset(
        (int(np.nanargmax(column)), i)
        for i, (_, column) in enumerate(wide(rows, bins, "mean").items(), start=1)
        if column.nunique() > 1
    )
    data = rows.drop(columns="bin").rename(columns={"mean": "mean_percent", "sd": "sd_percent"})
    of = {"caption": f"{metric} {by} · {label}", "name": slug(measure, by, label), "data": data}
    return _by_bin(rows, bins, ("mean", "sd"), plus_minus, best=best, **of)


def by_sector_section(analysis: Analysis) -> Section | None:
    """Show recall by sector around the vehicle; None where it was not measured."""
    run = analysis.run
    if run.sector is None or run.sector.empty:
        return None
    note = (
        f"Test frames, sectors of 45 degrees around {name_of(run.sweep.body)}; an object is in "
        "that of its centre. Recall: means over seeds ± standard deviation."
    )
    section = Section("Objects by their direction", [note])
    for label, rows in means_by_bin(run, analysis.groups, run.sector, SECTOR, _METRIC):
        section.tables.append(_metric_table(*in_sectors(rows), "Recall", "by direction", label))
    return section


def in_sectors(table: pd.DataFrame) -> tuple[pd.DataFrame, Bins]:
    """Name the sector of every row in a column `bin`; all sectors from the left on."""
    named = table.assign(bin=table["sector"])
    from_the_left = named.sort_values("from_deg", ascending=False)["bin"].unique()
    return named, Bins("direction of the object", tuple(from_the_left))


def by_distance_section(analysis: Analysis) -> Section | None:
    """Show points per object, then AP, by distance; None for a sweep without detectors."""
    run = analysis.run
    if not has_detectors(run):
        return None
    section = Section("Objects by their distance")
    if run.points is None or run.points.empty or run.distance is None:
        section.notes.append("The run folder has no points.parquet and distance.parquet.")
        return section
    section.notes.append(
        "Test frames; distance is from the origin of the ego frame to the centre of the object. "
        "Points: the mean over objects, those without any included. AP: means over seeds ± "
        "standard deviation; with n below 41 objects even a perfect detector has (n - 1) / 40."
    )
    for title, part in by_setting(run.points, run.axes):
        for name, rows in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            named, rings = in_rings(rows)
            section.tables.append(_points_table(named, rings, label))
    for label, rows in means_by_bin(run, analysis.groups, run.distance, RING, HEADLINE_METRIC):
        section.tables.append(_metric_table(*in_rings(rows), "AP", "by distance", label))
    return section


def in_rings(table: pd.DataFrame) -> tuple[pd.DataFrame, Bins]:
    """Name the ring of every row in a column `bin`; all rings from the nearest on."""
    pairs = zip(table["from_m"], table["to_m"], strict=True)
    named = table.assign(bin=[f"{a:g}–{b:g}" if np.isfinite(b) else f"{a:g}+" for a, b in pairs])
    order = named.sort_values("from_m")["bin"].unique()
    return named, Bins("distance of the object (m)", tuple(order), " m")


def _points_table(rows: pd.DataFrame, rings: Bins, label: str) -> Table:
    def cell(mean: float, share: float) -> str:
        return (
            DASH
            if np.isnan(mean)
            else f"{digits(mean, ',.0f' if mean >= 100 else '.3g')} ({100 * share:.0f} %)"
        )

    caption = f"Points per object, share of the objects without any in brackets · {label}"
    names = {"mean": "points_mean", "median": "points_median"}
    data, name = rows.drop(columns="bin").rename(columns=names), slug("points per object", label)
    return _by_bin(rows, rings, ("mean", "unseen"), cell, caption=caption, name=name, data=data)
