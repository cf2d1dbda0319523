"""Error against run time of the surrogates: `lidarplace accuracy BOX_LOG`."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

from lidarplace import PAPER_PLACEMENTS, Placement, Roi
from lidarplace.base.ranges import AZIMUTH_STEPS, FRAMES, RESOLUTION, SHARE
from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import (
    JsonOption,
    checked_input,
    known,
    new_app,
    print_json,
    verb,
    within,
)
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.logs.boxes import CLASSES

app = new_app()


@verb(app, "logs/sumo-1 --config examples/grid.yaml --out runs/accuracy")
def accuracy_command(
    log: Annotated[
        Path, typer.Argument(help="folder of boxes.parquet and frames.parquet, or boxes alone")
    ],
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="of a sweep: its placements, LiDAR and ROI")
    ] = None,
    placement: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="of the paper's or of --config; repeatable; all by default",
            autocompletion=lambda: list(PAPER_PLACEMENTS),
        ),
    ] = None,
    class_: Annotated[
        list[str] | None,
        typer.Option(
            "--class",
            metavar="NAME",
            help="repeatable; Car by default",
            autocompletion=lambda: list(CLASSES),
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
    """Compare methods to compute the surrogates: relative error, rank agreement, seconds.

    Writes OUT.parquet, OUT.csv and OUT.html.
    """
    from lidarplace.pog.surrogates.error_against_time import accuracy
    from tracking.findings.surrogate_accuracy import relative_errors, summarise

    resolutions = resolution or [0.1, 0.05, 0.2]
    with checked_input():
        found = _read(log, frames)
        roi, placements = _scene(config, resolutions[0], placement or [])
        result = accuracy(
            found.boxes,
            found.frames,
            roi,
            class_ or ["Car"],
            placements,
            resolutions[1:],
            azimuth_steps or (90, 360, 1440, 5760),
            frames_share or (0.5, 0.25),
        )
        errors = relative_errors(result)
        summary = summarise(errors)
        paths = _write(errors, summary, out)
    if as_json:
        rows = json.loads(summary.to_json(orient="records", double_precision=15))
        print_json({"files": paths, "summary": rows})
    else:
        _print(summary)
        say(", ".join(paths.values()))


def _read(path: Path, frames: int | None) -> BoxLog:
    from lidarplace.scenes.datasets.tabular import read_tabular

    if not path.exists():
        raise ValueError(f"{path}: no such file or folder")
    if path.is_dir():
        return read_box_log(path)
    if frames is None:
        raise ValueError(f"{path}: number of frames unknown; add --frames T")
    return read_tabular(path, frames=frames)


def _scene(
    config: Path | None, resolution: float, names: Sequence[str]
) -> tuple[Roi, list[Placement]]:
    roi, placements = Roi((0, 40), (-20, 20), (0, 4), resolution), dict(PAPER_PLACEMENTS)
    if config is not None:
        from sweeps.configuration.grid import read_sweep

        sweep = read_sweep(config)
        point = sweep.points[0].point
        roi = Roi(point.roi.x, point.roi.y, point.roi.z, resolution)
        used = [grid_point.point.placement for grid_point in sweep.points]
        placements = {name: sweep.rigs.of(point, name) for name in [*used, *sweep.rigs.own]}
    return roi, [known("placement", name, placements) for name in (names or placements)]


def _print(summary: pd.DataFrame) -> None:
    """The tables of the report."""
    from tracking.report.sections.accuracy import accuracy_table

    # These have the errors of S-MIG and IG, or none that depends on the placement.
    same = summary["surrogate"].isin(["covered_entropy", "residual_entropy", "h_pog"])
    for name, own in summary[~same].groupby("class", sort=False):
        shown = accuracy_table(own, str(name))
        words = {shown.head[i] for i in shown.words}
        output().print(table(shown.caption, shown.head, shown.rows, words))


def _write(errors: pd.DataFrame, summary: pd.DataFrame, out: Path) -> dict[str, str]:
    """The table of all errors, and a page of figures. Returns the paths by suffix."""
    from lidarplace.files.atomic import replacing
    from lidarplace.files.csv import write_csv
    from tracking.pages.page import SECTIONS_ALONE, write_page
    from tracking.pages.section import Section
    from tracking.report.sections.accuracy import accuracy_figure

    paths = {suffix: out.with_name(f"{out.name}.{suffix}") for suffix in ("parquet", "csv", "html")}
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(paths["parquet"]) as partial:
        errors.to_parquet(partial, index=False)
    write_csv(errors, paths["csv"])
    section = Section("Error against run time", columns=1)
    for name, own in summary.groupby("class", sort=False):
        section.figures.append(accuracy_figure(own, f"Error against run time · {name}"))
    write_page(paths["html"], SECTIONS_ALONE, [section], name=out.name)
    return {suffix: str(path) for suffix, path in paths.items()}
