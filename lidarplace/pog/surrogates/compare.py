"""Placements side by side: a row a placement, a column a surrogate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.evaluate import check_grid, evaluate_many
from lidarplace.pog.surrogates.table import POG_SURROGATES, SURROGATES
from lidarplace.rigs.placement import Placement


def compare(placements: Sequence[Placement], grid: OccupancyGrid, **options: Any) -> pd.DataFrame:
    """Surrogates of several placements for the class of `grid`.

    Args:
        options: the keywords of `evaluate_classes`, such as `surrogates=["expected_ig"]`.

    Returns:
        A row a placement, by its name, in the order given; a column a surrogate that was computed.

    Raises:
        ValueError: two placements have one name, or as `evaluate`.
    """
    check_grid(grid)
    names = pd.Index([placement.name for placement in placements], name="placement")
    if (twice := names[names.duplicated()]).size:
        raise ValueError(f"placements need names of their own, found {twice[0]!r} twice")
    found = evaluate_many({grid.object_class: grid}, placements, **options)
    own = [result[grid.object_class] for result in found]
    shown = POG_SURROGATES.among((*SURROGATES.own, *own[0].values))
    values = {name: [result[name] for result in own] for name in shown}
    return pd.DataFrame(values, index=names).dropna(axis="columns", how="all")
