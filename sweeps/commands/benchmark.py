"""Compare a predictor with the results of detectors: `lidarplace benchmark covered_entropy`."""

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
            "placement and a box log to a number, high for good rigs; by default all built-in "
            "predictors"
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare a predictor with the results of detectors trained for each of 41 rigs.

    Prints Spearman's rho with intervals, regret, and how many pairs of rigs it orders correctly, by
    metric and by the rigs' origin, and the tables of built-in predictors with its row. Surrogates
    take a minute, a checkpoint as long as its detections in 41 times 1,120 frames."""
    from rich.progress import track

    from sweeps.benchmark.markdown import markdown_row, markdown_table
    from sweeps.benchmark.predictors import predict
    from sweeps.benchmark.rigs import HEADLINES, built_in
    from sweeps.benchmark.scores import scores

    values, seconds = built_in()
    if predictor is not None:
        console = Terminal(stderr=True)

        def every(rigs: Iterable[str]) -> Iterable[str]:
            return track(list(rigs), "rigs", console=console, disable=not console.is_terminal)

        with checked_input():
            # Its own numbers stand for those of the package.
            values[predictor], seconds[predictor] = predict(predictor, every)
    scored = {name: table_ for name, table_ in values.items() if predictor in (None, name)}
    if as_json:
        rows = scores(scored).assign(seconds=lambda table_: table_["predictor"].map(seconds))
        print_json(json.loads(rows.to_json(orient="records", double_precision=15)))
        return
    if predictor is not None:
        _print_scores(scores(scored))
    compared = scores(values, HEADLINES)
    for metric in HEADLINES:
        say(f"### {metric}\n\n{markdown_table(compared, seconds, metric)}\n")
    if predictor is not None:
        say("Rows for these tables:")
        for metric in HEADLINES:
            say(markdown_row(compared, predictor, seconds, metric))


def _print_scores(scores: pd.DataFrame) -> None:
    from sweeps.benchmark.markdown import percent, rho_cell
    from tracking.labels import digits, span

    rows = [
        [
            row["metric"],
            row["population"],
            row["rigs"],
            rho_cell(row),
            digits(row["ceiling"], "z.2f"),
            row["takes"],
            digits(row["regret"], ".1f"),
            span(row["regret_low"], row["regret_high"], ".1f"),
            percent(row["right"]),
            row["pairs"],
        ]
        for row in scores.to_dict("records")
    ]
    head = ["metric", "rigs", "number", "ρ (95 %)", "ceiling", "takes", "loses, points", "95 %"]
    output().print(table(None, [*head, "pairs right", "of"], rows, words={"rigs", "takes"}))
