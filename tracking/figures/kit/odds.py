"""How likely each row is to be the best, beside a figure of rows."""

from collections.abc import Sequence

import plotly.graph_objects as go

from tracking.figures.kit.style import text


def add_odds(plot: go.Figure, odds: Sequence[str]) -> None:
    """Write them on the right, a row each from 0 at the top on, with a head above."""
    for row, words in [*enumerate(map(text, odds)), (-0.9, "likely to<br>be the best")]:
        plot.add_annotation(
            x=1.01,
            xref="paper",
            xanchor="left",
            y=row,
            text=words,
            align="left",
            showarrow=False,
            font={"size": 11},
        )
    plot.update_yaxes(range=[len(odds) - 0.5, -1.4])
    plot.update_layout(margin={"r": 84})
