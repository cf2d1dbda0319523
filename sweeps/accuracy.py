"""Error against run time of the surrogates: `python -m sweeps.accuracy BOX_LOG`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

from lidarplace import PAPER_PLACEMENTS, Placement, Roi
from lidarplace.boxes import CLASSES
from lidarplace.command_line.options import classes as classes_of_objects
from lidarplace.command_line.options import paper_placements
from lidarplace.command_line.terminal import output, say
from lidarplace.command_line.verbs import JsonOption, new_app, print_json, verb, within, wrong
from lidarplace.command_line.verbs import known as known_name
from lidarplace.ranges import AZIMUTH_STEPS, FRAMES, RESOLUTION, SHARE

_SUFFIXES = ("parquet", "csv", "html")

app = new_app()


@verb(app, "logs/sumo-1 --config examples/grid.yaml --out runs/accuracy")
def accuracy_command(
    log: Annotated[
        Path,
        typer.Argument(help="folder of boxes.parquet and frames.parquet, or boxes alone"),
    ],
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="of a sweep: its placements, LiDAR and ROI"),
    ] = None,
    placement: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="of the paper's or of --config; repeatable; all by default",
            autocompletion=paper_placements,
        ),
    ] = None,
    class_: Annotated[
        list[str] | None,
        typer.Option(
            "--class",
            metavar="NAME",
            help="repeatable; Car by default",
            autocompletion=classes_of_objects,
        ),
    ] = None,
    resolution: Annotated[
        list[float] | None,
        typer.Option(
            help="m; repeatable: methods, steps and frames are varied at the first one",
            callback=within(RESOLUTION),
        ),
    ] = None,
    azimuth_steps: Annotated[
        list[int] | None,
        typer.Option(help="rays of a beam a turn; repeatable", callback=within(AZIMUTH_STEPS)),
    ] = None,
    frames_share: Annotated[
        list[float] | None,
        typer.Option(help="of the POG's frames; repeatable", callback=within(SHARE)),
    ] = None,
    frames: Annotated[
        int | None, typer.Option(help="T, for a file of boxes alone", callback=within(FRAMES))
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="PATH", help="of the results, without suffix")
    ] = Path("accuracy"),
    as_json: JsonOption = False,
) -> None:
    """Compare ways to compute the surrogates: relative error, rank agreement, seconds.

    Writes OUT.parquet, OUT.csv and OUT.html.
    """
    from lidarplace.surrogates.error_against_time import accuracy
    from tracking.findings.surrogate_accuracy import relative_errors, summarise

    resolutions = resolution or [0.1, 0.05, 0.2]
    try:
        boxes, table = _read(log, frames)
        roi, placements = _scene(config, resolutions[0], placement or [])
        classes = class_ or ["Car"]
        unknown = [name for name in classes if name not in CLASSES]
        if unknown:
            raise ValueError(f"--class {unknown[0]}: allowed are {', '.join(CLASSES)}")
        result = accuracy(
            boxes,
            table,
            roi,
            classes,
            placements,
            resolutions[1:],
            azimuth_steps or (90, 360, 1440, 5760),
            frames_share or (0.5, 0.25),
        )
        errors = relative_errors(result)
        summary = summarise(errors)
        _write(errors, summary, out)
    except (OSError, ValueError) as error:
        wrong(error)
    paths = {suffix: str(out.with_name(f"{out.name}.{suffix}")) for suffix in _SUFFIXES}
    if as_json:
        rows = json.loads(summary.to_json(orient="records", double_precision=15))
        print_json({"files": paths, "summary": rows})
    else:
        _print(summary)
        say(", ".join(paths.values()))


def _read(path: Path, frames: int | None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Boxes and the frames table."""
    from lidarplace.box_log import read_box_log
    from lidarplace.boxes import check_boxes, check_classes, frame_keys
    from lidarplace.files.columns import frame_numbers
    from lidarplace.files.tables import read_csv, read_parquet

    if not path.exists():
        raise ValueError(f"{path}: no such file or folder")
    if path.is_dir():
        log = read_box_log(path)
        return log.boxes, log.frames
    boxes = read_csv(path) if path.suffix == ".csv" else read_parquet(path)
    check_boxes(boxes, str(path))
    check_classes(boxes, str(path))
    boxes["frame"] = frame_numbers(boxes, str(path))
    if frames is None:
        raise ValueError(f"{path}: boxes alone do not tell the number of frames; name --frames T")
    keys = frame_keys(boxes)
    table = boxes[keys].drop_duplicates()
    if len(table) > frames:
        raise ValueError(f"--frames {frames}: {path} has boxes of {len(table)} frames")
    # The frames without boxes have numbers that no box has.
    empty = pd.DataFrame({"frame": boxes["frame"].max() + 1 + pd.RangeIndex(frames - len(table))})
    if "scene" in keys:
        empty["scene"] = "no boxes"
    return boxes, pd.concat([table.sort_values(keys), empty], ignore_index=True)


def _scene(
    config: Path | None, resolution: float, names: Sequence[str]
) -> tuple[Roi, list[Placement]]:
    if config is None:
        roi = Roi((0, 40), (-20, 20), (0, 4), resolution)
        known = dict(PAPER_PLACEMENTS)
    else:
        from sweeps.configuration.grid import read_sweep

        sweep = read_sweep(config)
        point = sweep.points[0].point
        roi = Roi(point.roi.x, point.roi.y, point.roi.z, resolution)
        lidar = point.lidar.lidar()
        used = [grid_point.point.placement for grid_point in sweep.points]
        known = {
            name: sweep.common.placement_named(name, lidar)
            for name in dict.fromkeys([*used, *sweep.common.placements])
        }
    return roi, [known_name("placement", name, known) for name in (names or known)]


def _print(summary: pd.DataFrame) -> None:
    from rich.table import Table

    from tracking.labels import surrogate_name

    console = output()
    # These have the errors of S-MIG and IG, or none that depends on the placement.
    same = summary["surrogate"].isin(["covered_entropy", "residual_entropy", "h_pog"])
    shown = summary[~same]
    for object_class, own in shown.groupby("class", sort=False):
        table = Table(title=f"{object_class}: errors in percent, medians over placements")
        head = ("surrogate", "method", "m", "steps", "frames", "fine ref.", "same res.")
        for name in (*head, "τ", "s"):
            table.add_column(name, justify="left" if name in head[:2] else "right")
        for row in own.to_dict("records"):
            table.add_row(
                surrogate_name(row["surrogate"]),
                row["method"],
                f"{row['resolution']:g}",
                str(row["azimuth_steps"] or "all"),
                str(row["frames"]),
                f"{100 * row['median_error']:.3g}",
                f"{100 * row['median_method_error']:.3g}",
                f"{row['kendall']:.2f}",
                f"{row['seconds']:.3g}",
            )
        console.print(table)


def _write(errors: pd.DataFrame, summary: pd.DataFrame, out: Path) -> None:
    from lidarplace.files.atomic import replacing
    from lidarplace.files.csv import write_csv
    from sweeps.store.local import write_text
    from tracking.figures.kit.style import theme
    from tracking.figures.of_sweeps.accuracy import accuracy_figure

    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out.with_name(out.name + ".parquet")) as partial:
        errors.to_parquet(partial, index=False)
    with replacing(out.with_name(out.name + ".csv")) as partial:
        write_csv(errors, partial)
    figures = [
        accuracy_figure(own, f"Error against run time · {name}")
        .update_layout(template=theme(False))
        .to_html(full_html=False, include_plotlyjs=first, config={"displayModeBar": False})
        for first, (name, own) in zip(
            [True] + [False] * len(summary), summary.groupby("class", sort=False), strict=False
        )
    ]
    page = "<!DOCTYPE html><meta charset='utf-8'><title>Accuracy</title>" + "".join(figures)
    write_text(out.with_name(f"{out.name}.html"), page)


if __name__ == "__main__":
    app()
