"""How well does a predictor tell what detectors reach? `lidarplace benchmark covered_entropy`."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated

import typer

from lidarplace.command_line.terminal import Terminal, output, say, table
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb

if TYPE_CHECKING:
    import pandas as pd

app = new_app()


@verb(app, "expected_recall", "runs/mine/generalist.pt", "my_package.placing:score", "")
def benchmark(
    predictor: Annotated[
        str | None,
        typer.Argument(
            help="a surrogate's name, a generalist's checkpoint, or module:function that maps a "
            "placement and a box log to a number, high for good rigs; without, all built-in ones"
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare a predictor with what detectors of their own reached on 41 rigs.

    Prints Spearman's rho with intervals, regret, and how many pairs of rigs it orders rightly, by
    metric and by the rigs' origin, and rows for the tables of docs/benchmark.md. Surrogates take a
    minute, the checkpoint of a small detector about an hour on two cores.
    """
    from rich.progress import track

    from sweeps.benchmark.predictors import predict
    from sweeps.benchmark.rigs import METRICS, read
    from sweeps.benchmark.scores import scores

    built_in = read("predicted")
    values = {
        str(name): own.set_index("placement")[list(METRICS)]
        for name, own in built_in.groupby("predictor", sort=False)
    }
    seconds = dict(zip(built_in["predictor"], built_in["seconds"], strict=True))
    if predictor is not None:
        console = Terminal(stderr=True)

        def every(rigs: Iterable[str]) -> Iterable[str]:
            return track(list(rigs), "rigs", console=console, disable=not console.is_terminal)

        with checked_input():
            found = predict(predictor, every)
        # Its own numbers stand for those of the package.
        values[predictor], seconds[predictor] = found.values, found.seconds
    if as_json:
        shown = values if predictor is None else {predictor: values[predictor]}
        rows = scores(shown).assign(seconds=lambda own: own["predictor"].map(seconds))
        print_json(json.loads(rows.to_json(orient="records", double_precision=15)))
    elif predictor is None:
        _print_tables(values, seconds)
    else:
        _print_scores(predictor, values, seconds)


def _print_tables(values: dict[str, pd.DataFrame], seconds: dict[str, float]) -> None:
    """Markdown, one table for each headline metric."""
    from sweeps.benchmark.markdown import markdown_table
    from sweeps.benchmark.rigs import HEADLINES
    from sweeps.benchmark.scores import scores

    found = scores(values, HEADLINES)
    for metric in HEADLINES:
        say(f"### {metric}\n\n{markdown_table(found, seconds, metric)}\n")


def _print_scores(
    predictor: str, values: dict[str, pd.DataFrame], seconds: dict[str, float]
) -> None:
    from sweeps.benchmark.markdown import label, markdown_row, percent, rho_cell
    from sweeps.benchmark.rigs import HEADLINES
    from sweeps.benchmark.scores import scores
    from tracking.numbers import digits, span

    own = scores({predictor: values[predictor]})
    by_metric = {key: rows.to_dict("records") for key, rows in own.groupby("metric", sort=False)}
    origins = [row["population"] for row in by_metric[HEADLINES[0]]]
    head = ["metric", "ceiling", *origins[:-1], "all (95 %)"]
    table_rows = [
        [
            metric,
            digits(rows[-1]["ceiling"], "z.2f"),
            *(digits(row["rho"], "z.2f") for row in rows[:-1]),
            rho_cell(rows[-1]),
        ]
        for metric, rows in by_metric.items()
    ]
    console = output()
    title = f"Spearman's ρ of {label(predictor)} with own detectors"
    console.print(table(title, head, table_rows))
    head = ["", "rigs", "ρ (95 %)", "ceiling", "takes", "loses, points (95 %)", "pairs right", "of"]
    for metric in HEADLINES:
        table_rows = [
            [
                row["population"],
                row["rigs"],
                rho_cell(row),
                digits(row["ceiling"], "z.2f"),
                row["takes"],
                f"{digits(row['regret'], '.1f')} "
                f"({span(row['regret_low'], row['regret_high'], '.1f')})",
                percent(row["right"]),
                row["pairs"],
            ]
            for row in by_metric[metric]
        ]
        console.print(table(metric, head, table_rows, words={"takes"}))
    everywhere = scores(values, HEADLINES).query("population == 'all'").to_dict("records")
    rhos = {(row["predictor"], row["metric"]): row["rho"] for row in everywhere}
    shown = [
        [label(name) + (" ←" if name == predictor else ""), digits(seconds[name], ".2g")]
        + [digits(rhos[name, metric], "z.2f") for metric in HEADLINES]
        for name in sorted(values, key=lambda name: -rhos[name, HEADLINES[0]])
    ]
    head = ["predictor", "s a rig", *HEADLINES]
    console.print(table("All predictors, ρ over all rigs", head, shown))
    say("Rows for the tables of docs/benchmark.md:")
    for metric in HEADLINES:
        say(f"{metric}:\n{markdown_row(own, predictor, seconds[predictor], metric)}")
