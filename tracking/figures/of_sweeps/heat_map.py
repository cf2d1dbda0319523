"""Spearman's rho of surrogates with metrics, as a table of colours."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from tracking.figures.kit.style import figure, text, two_lines
from tracking.labels import in_order, signed, surrogate_name

SIGNIFICANT = 0.05


_TILTED = 5  # pixels that a letter of a column's name reaches down


def heat_map(correlations: pd.DataFrame, labels: Sequence[str], title: str) -> go.Figure | None:
    """Surrogates as columns, `labels` as rows; blue falls, orange rises.

    A star stands where p, adjusted for all tests, is below `SIGNIFICANT`.

    Args:
        correlations: rows of `tracking.findings.correlation.correlate`.
        labels: what each of them is called, equal for those that share a row of the figure.

    Returns:
        None if there is no coefficient at all.
    """
    cells = correlations.assign(row=list(labels))
    cells = cells[cells["spearman"].notna()]
    if cells.empty:
        return None
    rho, p, holm = (
        cells.pivot(index="row", columns="surrogate", values=value).reindex(
            index=list(dict.fromkeys(cells["row"])), columns=in_order(cells["surrogate"])
        )
        for value in ("spearman", "spearman_p", "spearman_holm")
    )
    # Plotly sizes the numbers by their letters and would count those of tags too.
    shown = np.where(holm < SIGNIFICANT, rho.map(signed) + "★", rho.map(signed))
    names = [surrogate_name(str(name)) for name in rho.columns]
    below = max(84, 16 + _TILTED * max(map(len, names)))
    margin = {"l": 120, "r": 8, "t": 48, "b": below}
    plot = figure(title, height=56 + below + 34 * len(rho), margin=margin)
    add_coefficients(
        plot,
        rho,
        names,
        [two_lines(text(name)) for name in rho.index],
        shown,
        hover=", p = %{customdata[0]:.2g}, adjusted %{customdata[1]:.2g}",
        customdata=np.stack([p.to_numpy(), holm.to_numpy()], axis=-1),
    )
    return plot


def add_coefficients(
    plot: go.Figure,
    rho: pd.DataFrame,
    columns: Sequence[str],
    rows: Sequence[str],
    shown: ArrayLike,
    hover: str = "",
    **further: Any,
) -> None:
    """Cells from -1, blue, to 1, orange.

    Args:
        rho: coefficients, NaN where there is none.
        columns, rows: what those of `rho` are called, plotly text.
        shown: the cells' texts.
        hover: text of a cell after its coefficient.
    """
    plot.add_heatmap(
        z=rho.to_numpy(),
        x=columns,
        y=rows,
        zmin=-1,
        zmax=1,
        # Two of Okabe and Ito's colours about a light middle, which keeps the numbers readable.
        colorscale=[[0, "#56B4E9"], [0.5, "#f7f7f7"], [1, "#E69F00"]],
        text=np.where(rho.isna(), "", shown),
        texttemplate="%{text}",
        textfont={"color": "#1d2126"},
        hovertemplate=f"%{{y}}, %{{x}}<br>ρ = %{{z:+.3f}}{hover}<extra></extra>",
        showscale=False,
        xgap=2,
        ygap=2,
        **further,
    )
    plot.update_yaxes(autorange="reversed", showgrid=False, ticks="")
    plot.update_xaxes(showgrid=False, ticks="", tickangle=-45)
