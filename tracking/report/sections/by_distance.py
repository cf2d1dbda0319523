"""The section of objects by their distance: points on them, and how well they are detected."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from lidarplace.metrics import HEADLINE_METRIC
from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.by_distance import by_distance, ring_label
from tracking.findings.groups import Group, by_setting, has_detectors
from tracking.findings.summary import seed_means
from tracking.kitti_iou import judged
from tracking.labels import metric_label
from tracking.numbers import plus_minus
from tracking.pages.section import Section
from tracking.pages.tables import Table, slug
from tracking.run_folders.sweep import RunFolder

_RING = ["from_m", "to_m"]


def by_distance_section(run: RunFolder, found: list[Group]) -> Section | None:
    """Points per object, then AP, by distance; None for a sweep without detectors."""
    if not has_detectors(run):
        return None
    section = Section("Objects by their distance", columns=2)
    if run.points is None or run.points.empty or run.distance is None:
        section.notes.append("The run folder has no points.parquet and distance.parquet.")
        return section
    section.notes.append(
        "Test frames; distance is from the origin of the ego frame to the centre of the object. "
        "Points: the mean over objects, those without any included. AP: means over seeds with 95 % "
        "intervals, which do not contain the chance of which objects are in a ring; with n below "
        "41 of them even a perfect detector has (n - 1) / 40."
    )
    names = list(run.placements)
    for title, part in by_setting(run.points, run.axes):
        for name, own in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            drawn = own.assign(value=own["mean"], low=np.nan, high=np.nan)
            section.figures.append(
                by_distance(
                    drawn, f"Points per object · {text(label)}", "points per object", names, True
                )
            )
            section.tables.append(_points_table(own, label))
    for label, own in _headline(run, found):
        section.figures.append(
            by_distance(
                own.rename(columns={"mean": "value", "ground_truths": "objects"}),
                f"AP by distance · {text(label)}",
                f"{metric_label(HEADLINE_METRIC, own['iou'].iloc[0])} (%)",
                names,
            )
        )
        section.tables.append(_ap_table(own, label))
    return section


def _headline(run: RunFolder, found: list[Group]) -> Iterator[tuple[str, pd.DataFrame]]:
    """Means over seeds of headline AP by ring, for every group and class."""
    assert run.distance is not None
    for group in found:
        for name in run.classes:
            own = judged(group.of(run.distance), run.results, name)
            if own.empty:
                continue
            means = seed_means(own.assign(difficulty="all"), [*run.axes, *_RING])
            yield f"{name} · {group.title}" if group.varies else name, means


def _points_table(own: pd.DataFrame, label: str) -> Table:
    rings, wide = _wide(own, "mean")
    unseen = _wide(own, "unseen")[1]
    rows = tuple(
        (
            str(name),
            *(
                "–" if np.isnan(mean) else f"{mean:,.1f} ({100 * share:.0f} %)"
                for mean, share in zip(wide.loc[name], unseen.loc[name], strict=True)
            ),
        )
        for name in wide.index
    )
    return Table(
        f"Points per object, share of the objects without any in brackets · {label}",
        ("placement", *rings),
        rows,
        name=slug("points per object", label),
        data=own.rename(columns={"mean": "points_mean", "median": "points_median"}),
    )


def _ap_table(own: pd.DataFrame, label: str) -> Table:
    rings, wide = _wide(own, "mean")
    sd = _wide(own, "sd")[1]
    rows = tuple(
        (str(name), *(plus_minus(*cell) for cell in zip(wide.loc[name], sd.loc[name], strict=True)))
        for name in wide.index
    )
    best = frozenset(
        (int(np.nanargmax(wide[ring])), column) for column, ring in enumerate(wide, start=1)
    )
    caption = f"{metric_label(HEADLINE_METRIC, own['iou'].iloc[0])} (%) by distance · {label}"
    return Table(
        caption,
        ("placement", *rings),
        rows,
        best,
        name=slug("ap by distance", label),
        data=own.rename(columns={"mean": "mean_percent", "sd": "sd_percent"}),
    )


def _wide(own: pd.DataFrame, values: str) -> tuple[list[str], pd.DataFrame]:
    """Heads of the rings, and placements as rows in their order with rings as columns."""
    wide = own.pivot(index="placement", columns=_RING, values=values)
    wide = wide.reindex(own["placement"].unique())
    return [f"{ring_label(*ring)} m" for ring in wide.columns], wide
