"""A metric of every placement by what objects are told apart by: distance, direction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from tracking.figures.of_sweeps.by_bin import Bins
from tracking.findings.groups import Group
from tracking.findings.summary import seed_means
from tracking.kitti_iou import judged
from tracking.numbers import plus_minus
from tracking.pages.tables import Table
from tracking.run_folders.sweep import RunFolder


def means_by_bin(
    run: RunFolder, found: list[Group], table: pd.DataFrame, keys: list[str], metric: str
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Title and means over seeds of a metric at its headline IoU, for every group and class.

    Args:
        table: of the run folder.
        keys: its columns that tell bins apart.
    """
    for group in found:
        for name in run.classes:
            own = judged(group.of(table), run.results, name, metric)
            if own.empty:
                continue
            means = seed_means(own.assign(difficulty="all"), [*run.axes, *keys])
            yield f"{name} · {group.title}" if group.varies else name, means


def wide(own: pd.DataFrame, bins: Bins, values: str) -> pd.DataFrame:
    """Placements in their order as rows, bins as columns."""
    table = own.pivot(index="placement", columns="bin", values=values)
    return table.reindex(index=own["placement"].unique(), columns=bins.names)


def binned_table(own: pd.DataFrame, bins: Bins, caption: str, name: str) -> Table:
    """Mean ± sd of every placement and bin, the highest of a bin bold.

    Args:
        own: of `means_by_bin`, with its `bin`.
        name: of the file.
    """
    mean, sd = wide(own, bins, "mean"), wide(own, bins, "sd")
    rows = tuple(
        (str(row), *(plus_minus(*cell) for cell in zip(mean.loc[row], sd.loc[row], strict=True)))
        for row in mean.index
    )
    best = frozenset(
        (int(np.nanargmax(mean[column])), i)
        for i, column in enumerate(mean, start=1)
        if mean[column].notna().any()
    )
    return Table(
        caption,
        ("placement", *(f"{column}{bins.unit}" for column in bins.names)),
        rows,
        best,
        name=name,
        data=own.drop(columns="bin").rename(columns={"mean": "mean_percent", "sd": "sd_percent"}),
    )
