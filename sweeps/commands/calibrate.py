"""Detection curves of one's own detector: `lidarplace calibrate grid.yaml`, or of detections."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lidarplace.command_line.invocation import called, command
from lidarplace.command_line.options import FRONT_ROI, RoiOption, VehicleOption
from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import checked_input, new_app, verb, wrong
from lidarplace.files.atomic import check_replaceable
from sweeps import options

if TYPE_CHECKING:
    import pandas as pd

    from lidarplace.recall.detection_curve import DetectionCurve
    from sweeps.evaluation.request import DetectionOptions
    from tracking.pages.section import Section

app = new_app()


@verb(
    app,
    "examples/grid.yaml --out curves.json",
    "--log logs/av2 --rig roof=roof.feather --geometry roof=recorded --out curves.json",
)
def calibrate(
    config: Annotated[Path | None, typer.Argument(help="YAML file of a sweep")] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="file for the curves, and a page; by default they are only printed"
        ),
    ] = None,
    set_: options.SetOption = None,
    log: Annotated[
        Path | None, typer.Option(help="box log of the detections, instead of a sweep")
    ] = None,
    rig: options.RigsOption = None,
    geometry: options.GeometryOption = None,
    vehicle: VehicleOption = None,
    layout: options.LayoutOption = None,
    world: options.WorldFrameOption = False,
    calib: options.CalibOption = None,
    class_map: options.DetectionClassMapOption = "paper",
    roi: RoiOption = FRONT_ROI,
    class_: options.ClassesOption = None,
    split: options.SplitOption = "test",
    accept: options.AcceptOption = None,
) -> None:
    """Fit the curves of expected_recall to the detections of a sweep, or to those of --log.

    Trains nothing: trials without detections are skipped. Rigs, routes and objects are held out of
    the fit in turn, and predicted."""
    from sweeps.calibration.checks_section import checks_section
    from sweeps.calibration.left_out import check

    if (config is None) == (log is None) or (log is None and (rig or geometry or vehicle)):
        wrong("name the file of a sweep, or --log with --rig and --geometry")
    with checked_input():
        if out is not None:
            check_replaceable(out)
        if config is not None:
            seen = _of_sweep(config, set_ or [], class_ or [])
        else:
            from sweeps.evaluation.request import DetectionOptions

            read = DetectionOptions(
                log=Path(str(log)), rigs=rig, geometry=geometry, vehicle=vehicle,
                layout=layout, world=world, calib=calib, class_map=class_map, roi=roi,
                classes=class_, split=split, accept=accept,
            )  # fmt: skip
            seen = _of_detections(read)
        checks = [check(rows) for _, rows in seen.groupby(["class", "iou"], sort=True) if len(rows)]
    section = checks_section(checks)
    for part in section.tables:
        words = {part.head[i] for i in part.words}
        output().print(table(part.caption, part.head, part.rows, words))
    say("\n".join(section.notes))
    if out is not None:
        with checked_input():
            _write(out, [check.curve for check in checks], seen, section)


def _write(out: Path, curves: list[DetectionCurve], seen: pd.DataFrame, checked: Section) -> None:
    """Write the file of the curves and its page, and print how a sweep uses them."""
    from lidarplace.recall.detection_curve import write_curves
    from sweeps.calibration.curves_section import curves_section
    from tracking.pages.html_page import SECTIONS_ALONE, write_page

    write_curves(out, called(), curves)
    sections = [curves_section(curves, seen), checked]
    page = write_page(out.with_suffix(".html"), SECTIONS_ALONE, sections, name=out.stem)
    use = command("run", "sweep.yaml", "--set", f"surrogate.curves={out}")
    say(f"{out}: {len(curves)} curves, for a sweep: {use}\n{page}")


def _of_sweep(config: Path, overrides: list[str], classes: list[str]) -> pd.DataFrame:
    """Return observations of the trials with detections, of all classes if none is named."""
    from sweeps.calibration.observations import observations, rigs_of
    from sweeps.plan.plan import read_plan
    from sweeps.store.open import store_of

    sweep, plan = read_plan(config, overrides)
    store = store_of(sweep)
    rigs = rigs_of(plan.trials, store)
    if len(rigs) < 2:
        wrong(
            f"{config}: the store has detections of {len(rigs)} rig(s), at least 2 are needed; "
            f"{command('run', str(config))} makes them"
        )
    seen = observations(rigs, store)
    lacking = set(classes or plan.trials[0].grid_point.point.classes) - set(seen["class"])
    if seen.empty or (classes and lacking):
        wrong(f"{config}: no object of {', '.join(sorted(lacking))} is in its test frames")
    say(f"{sum(map(len, rigs.values()))} of {len(plan.trials)} trials are evaluated")
    return seen[seen["class"].isin(classes)] if classes else seen


def _of_detections(options: DetectionOptions) -> pd.DataFrame:
    import pandas as pd

    from lidarplace.recall.counted_objects import CountedObjects
    from lidarplace.recall.detection_curve import CELL_M
    from sweeps.calibration.observations import of_rig
    from sweeps.evaluation.request import read_request

    request = read_request(options)
    say("\n".join([*request.notes, *(f"warning: {text}" for text in request.cautions)]))
    test, places = request.test, request.geometry
    for name in request.rigs:
        if name not in places:
            wrong(f"--geometry: missing for rig {name}; expected {name}=recorded, LiDARs or a file")
    counted = (test.log, test.roi, test.classes, CELL_M)
    objects = CountedObjects.from_log(*counted, vehicle=request.vehicle)
    tables = [
        of_rig(name, places[name], seeds, objects, test.routes, test.classes, {})
        for name, seeds in request.rigs.items()
    ]
    return pd.concat(tables)
