"""Contents of a box log: `lidarplace describe LOG …`."""

import json
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer

from lidarplace.base.class_names import counts_of
from lidarplace.command_line.terminal import output, table
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.logs.boxes import CLASSES

app = new_app()

REGIONS = {
    "ROI": {"x": (-40.0, 40.0), "y": (-20.0, 20.0), "z": (0.0, 4.0)},
    "front": {"x": (0.0, 40.0), "y": (-20.0, 20.0), "z": (0.0, 4.0)},
}
"""The paper's region of interest, and the half of it that its experiments use."""


def describe(log: BoxLog) -> pd.DataFrame:
    """Count frames, and objects per frame whose centre is in each of `REGIONS`, by scene and split.

    Returns columns scene, split, routes, frames, and for every region and class a mean number of
    objects per frame, `<region> <class>`; the last row is the whole log."""
    classes = list(dict.fromkeys(CLASSES) | counts_of(log.boxes["class"]))
    counts = log.frames[["scene", "split", "route", "frame"]].set_index("frame")
    for region, bounds in REGIONS.items():
        between = [log.boxes[axis].between(low, high) for axis, (low, high) in bounds.items()]
        inside = between[0] & between[1] & between[2]
        for name in classes:
            of_class = log.boxes[inside & (log.boxes["class"] == name)]
            counts[f"{region} {name}"] = of_class.groupby("frame").size()
    columns = [f"{region} {name}" for region in REGIONS for name in classes]
    counts[columns] = counts[columns].fillna(0.0)
    groups = counts.groupby(["scene", "split"], sort=False)
    table = groups.agg(routes=("route", "nunique"), frames=("route", "size"))
    table = table.join(groups[columns].mean()).reset_index()
    sizes = {"routes": counts["route"].nunique(), "frames": len(counts)}
    whole = {"scene": "all", "split": "", **sizes, **counts[columns].mean()}
    return pd.concat([table, pd.DataFrame([whole])], ignore_index=True)


def print_description(log: BoxLog, title: str) -> None:
    """Print `describe(log)` as a table."""
    counts = describe(log)
    rows = counts.map(lambda cell: f"{cell:.2f}" if isinstance(cell, float) else cell).to_numpy()
    head = counts.columns.tolist()
    output().print(table(f"{title}: objects per frame", head, rows, words={"split"}))


@verb(app, "logs/town03", "logs/town03 logs/town05 --json")
def main(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="folders of box logs")],
    as_json: JsonOption = False,
) -> None:
    """Print frames and objects per frame of box logs.

    Counts objects with their centre in the paper's region of interest, and in its front half."""
    with checked_input():
        box_logs = {str(folder): read_box_log(folder) for folder in logs}
    if as_json:
        form: Any = {"orient": "records", "double_precision": 15}  # null for what is not known
        print_json({n: json.loads(describe(log).to_json(**form)) for n, log in box_logs.items()})
        return
    for name, log in box_logs.items():
        print_description(log, name)
