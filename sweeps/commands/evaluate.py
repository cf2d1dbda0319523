"""AP and recall of detections from elsewhere: `lidarplace evaluate LOG DETECTIONS`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lidarplace.command_line.invocation import command
from lidarplace.command_line.options import FRONT_ROI, LogArgument, RoiOption, VehicleOption
from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from sweeps import options

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from sweeps.evaluation.request import EvaluationRequest

app = new_app()

REPORTED = ("AP_R40_3D", "AP_R40_BEV", "class_recall_3D", "recall")
"""Metrics in the terminal, at the strict IoU of a class."""
_COLUMNS = ["placement", "class", "metric", "iou", "ground_truths", "mean", "low", "high"]


@verb(
    app,
    "logs/kitti results/data",
    "logs/av2 --rig roof=roof.feather --rig corners=corners.feather --out runs/roof",
)
def evaluate(
    log: LogArgument,
    detections: Annotated[
        list[Path] | None, typer.Argument(help="files, or folders of them, of one rig")
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
    counted: options.CountedOption = "visible",
    accept: options.AcceptOption = None,
    generalist: Annotated[
        bool,
        typer.Option(
            "--generalist",
            help="one network made the detections of all rigs: intervals include only the test "
            "objects",
        ),
    ] = False,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="folder for the pages of two rigs or more")
    ] = Path("runs/evaluation"),
    as_json: JsonOption = False,
) -> None:
    """Print AP and recall of detections from elsewhere, with intervals over the test objects.

    Reads KITTI's result files, nuScenes' JSON, Argoverse 2's feather, Waymo's and plain Parquet.
    Two rigs or more become a run folder with a decision page, a failure page and a report."""
    from sweeps.evaluation.request import DetectionOptions, read_request

    with checked_input():
        request = read_request(
            DetectionOptions(
                log=log, detections=detections, rigs=rig, geometry=geometry, vehicle=vehicle,
                layout=layout, world=world, calib=calib, class_map=class_map, roi=roi,
                classes=class_, split=split, counted=counted, accept=accept,
            )
        )  # fmt: skip
        means, pages = _evaluated(request, out, generalist)
    for caution in request.cautions:
        say(f"warning: {caution}", sys.stderr)
    if as_json:
        rows = means[_COLUMNS].astype(object)
        print_json(rows.where(rows.notna(), None).to_dict("records"))
        return
    say("\n".join(request.notes))
    _print_means(means, request)
    say("\n".join([*pages, f"next: {_next_step(log, request)}"]))


def _evaluated(
    request: EvaluationRequest, out: Path, generalist: bool
) -> tuple[pd.DataFrame, list[str]]:
    """Return means over trainings and, of two rigs or more, the answer with pages in `out`."""
    from sweeps.evaluation.run_folder import check_free, evaluate_rigs, results_of, write_evaluation
    from tracking.findings.groups import ONE_FOR_ALL
    from tracking.findings.summary import seed_means
    from tracking.report.build import write_report

    several = len(request.rigs) > 1
    if several:
        check_free(out)
    results = evaluate_rigs(request)
    metrics, left_out = results_of(results)
    means = seed_means(metrics, (), left_out, ONE_FOR_ALL[0])
    if not several:
        return means, []
    evaluator = ONE_FOR_ALL[0] if generalist else "specialist"
    analysis, frames = write_evaluation(out, results, request, evaluator)
    page = write_report(analysis, frames)
    return means, [*analysis.headline, str(page), str(page.with_name("decision.html"))]


def _print_means(means: pd.DataFrame, request: EvaluationRequest) -> None:
    output().print(_metric_table(means, several=len(request.rigs) > 1))
    counts = means.groupby("class", sort=False)["ground_truths"].max()
    if none := counts.index[counts == 0].tolist():
        say(f"no AP, no recall: no object of {', '.join(none)} counts in these frames")
    if (few := counts[counts > 0].min()) <= 40:
        say(f"KITTI samples AP at 40 recalls: with {few} objects even perfect AP is below 100")
    say(
        "in brackets: 95 % over the routes or individuals of these frames, the wider of the two; "
        "without the spread of further trainings"
        if max(map(len, request.rigs.values())) == 1
        else "in brackets: 95 % over trainings and over the routes or individuals of these frames"
    )


def _next_step(log: Path, request: EvaluationRequest) -> str:
    """Return the step that adds most: a second rig, the mounts, or detection curves."""
    if len(request.rigs) == 1:
        rigs = command("evaluate", str(log), "--rig", "A=FILE", "--rig", "B=FILE")
        return f"compare rigs: {rigs}"
    if missing := [name for name in request.rigs if name not in request.geometry]:
        return f"show the LiDARs of {missing[0]}: --geometry {missing[0]}=recorded, or FILE.yaml"
    curves = command("calibrate", "--log", str(log), "--out", "curves.json")
    return (
        f"fit detection curves, to search without training: {curves}, --rig and --geometry as now"
    )


def _metric_table(means: pd.DataFrame, several: bool) -> Table:
    from lidarplace.base.metrics import METRICS
    from tracking.kitti_iou import at_headline_iou, headline_iou
    from tracking.labels import digits

    rows = []
    for (rig, name), values in means.groupby(["placement", "class"], sort=False):
        cells = []
        for metric in REPORTED:
            cells.append("")
            for row in at_headline_iou(values, means, str(name), metric).to_dict("records"):
                low, high = row["low"], row["high"]
                sure = f" ({low:.1f} to {high:.1f})" if high - low > 0.05 else ""
                cells[-1] = f"{digits(row['mean'], '.1f')}{sure}"
        iou = f"{headline_iou(means, str(name)):g}"
        objects = f"{values['ground_truths'].max():,}"
        rows.append([*([rig] if several else []), name, iou, objects, *cells])
    labels = [METRICS[name].label for name in REPORTED]
    head = (*(["rig"] if several else []), "class", "IoU", "objects", *labels)
    return table(None, head, rows, {"class"})
