"""Where the time of a sweep went."""

from __future__ import annotations

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import colour, figure, text


def times(tasks: pd.DataFrame) -> go.Figure:
    """Seconds of all tasks of a stage: spent in this run, and spared by results on disk.

    Args:
        tasks: stage, seconds (what the task took when it ran), cached.
    """
    stages = list(dict.fromkeys(tasks["stage"]))
    plot = figure("Time of all tasks by stage", height=130 + 34 * len(stages))
    for cached, name, shade in (
        (False, "spent in this run", colour(0)),
        (True, "spared: result was on disk", colour(6)),
    ):
        part = tasks[tasks["cached"].astype(bool) == cached].groupby("stage")["seconds"]
        total, count = part.sum(), part.size()
        here = [stage for stage in stages if stage in total.index]
        if not here:
            continue
        plot.add_bar(
            y=[text(stage) for stage in here],
            x=[total[stage] for stage in here],
            orientation="h",
            name=name,
            marker={"color": shade},
            text=[
                f"{total[stage]:,.{0 if total[stage] >= 10 else 2}f} s · {count[stage]} ×"
                for stage in here
            ],
            textposition="auto",
            hovertemplate="%{y}: %{x:,.1f} s<extra>" + name + "</extra>",
        )
    plot.update_layout(barmode="stack", legend={"orientation": "h", "y": -0.35})
    plot.update_xaxes(title="seconds, summed over workers")
    plot.update_yaxes(
        autorange="reversed", categoryorder="array", categoryarray=[text(stage) for stage in stages]
    )
    return plot
