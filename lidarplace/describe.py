"""What is in a box log: `python -m lidarplace.describe LOG …`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pandas as pd
import typer
from rich.table import Table

from lidarplace.box_log import BoxLog, read_box_log
from lidarplace.boxes import CLASSES
from lidarplace.command_line import output, wrong

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

REGIONS = {
    "ROI": {"x": (-40.0, 40.0), "y": (-20.0, 20.0), "z": (0.0, 4.0)},
    "front": {"x": (0.0, 40.0), "y": (-20.0, 20.0), "z": (0.0, 4.0)},
}
"""The paper's region of interest, and the half of it that its experiments use."""


def describe(log: BoxLog) -> pd.DataFrame:
    """Frames, and objects per frame whose centre is in each of `REGIONS`, by scene and split.

    Returns columns scene, split, routes, frames, and for every region and class a mean number of
    objects per frame, `<region> <class>`; the last row is the whole log.
    """
    counts = log.frames[["scene", "split", "route", "frame"]].set_index("frame")
    for region, bounds in REGIONS.items():
        inside = pd.Series(True, index=log.boxes.index)
        for axis, (low, high) in bounds.items():
            inside &= log.boxes[axis].between(low, high)
        for name in CLASSES:
            of_class = log.boxes[inside & (log.boxes["class"] == name)]
            counts[f"{region} {name}"] = of_class.groupby("frame").size()
    columns = [f"{region} {name}" for region in REGIONS for name in CLASSES]
    counts[columns] = counts[columns].fillna(0.0)
    groups = counts.groupby(["scene", "split"], sort=False)
    table = groups.agg(routes=("route", "nunique"), frames=("route", "size"))
    table = table.join(groups[columns].mean()).reset_index()
    whole = {
        "scene": "all",
        "split": "",
        "routes": counts["route"].nunique(),
        "frames": len(counts),
        **counts[columns].mean(),
    }
    return pd.concat([table, pd.DataFrame([whole])], ignore_index=True)


def print_description(log: BoxLog, title: str) -> None:
    """Print `describe(log)` as a table."""
    table = Table(title=f"{title}: objects per frame", title_justify="left")
    found = describe(log)
    for column in found.columns:
        table.add_column(column, justify="left" if column in ("scene", "split") else "right")
    for row in found.itertuples(index=False):
        table.add_row(*(f"{cell:.2f}" if isinstance(cell, float) else str(cell) for cell in row))
    output().print(table)


@app.command()
def main(logs: Annotated[list[Path], typer.Argument(help="folders of box logs")]) -> None:
    """Print frames and objects per frame of box logs.

    Example: python -m lidarplace.describe logs/town03
    """
    for folder in logs:
        try:
            log = read_box_log(folder)
        except (OSError, ValueError) as error:
            wrong(error)
        print_description(log, str(folder))


if __name__ == "__main__":
    app()
