"""Detection curves from the detections of a sweep: `lidarplace calibrate grid.yaml`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lidarplace.command_line.invocation import called, command
from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import checked_input, new_app, verb, wrong
from lidarplace.files.atomic import check_replaceable
from sweeps.options import ConfigArgument, SetOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from sweeps.calibration.left_out import Check

app = new_app()


@verb(app, "examples/grid.yaml --out curves.json")
def calibrate(
    config: ConfigArgument,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="file for the curves; without, they are printed alone"),
    ] = None,
    set_: SetOption = None,
) -> None:
    """Fit the curves of expected_recall to the detections that a sweep has in its store.

    Trains nothing: trials without detections yet are left out. Every rig is left out of a fit in
    turn, and predicted.
    """
    from lidarplace.recall.detection_curve import write_curves
    from sweeps.calibration.left_out import check
    from sweeps.calibration.observations import observations, rigs_of
    from sweeps.plan.plan import read_plan
    from sweeps.store.open import store_of

    overrides = set_ or []
    with checked_input():
        if out is not None:
            check_replaceable(out)
        sweep, plan = read_plan(config, overrides)
        store = store_of(sweep)
        rigs = rigs_of(plan.trials, store)
        if len(rigs) < 2:
            wrong(
                f"{config}: the store has detections of {len(rigs)} rig(s), at least 2 are needed; "
                f"{command('run')} {config} makes them"
            )
        seen = observations(rigs, store)
    checks = [check(own) for _, own in seen.groupby(["class", "iou"], sort=True) if len(own)]
    if not checks:
        classes = ", ".join(plan.trials[0].grid_point.point.classes)
        wrong(f"{config}: no object of {classes} is in its test frames")
    console = output()
    trials = sum(map(len, rigs.values()))
    console.print(f"{trials} of {len(plan.trials)} trials are evaluated")
    print_checks(console, checks)
    if out is None:
        return
    with checked_input():
        write_curves(out, called(), [own.curve for own in checks])
    console.print(f"{out}: {len(checks)} curves", soft_wrap=True)


def print_checks(console: Console, checks: Sequence[Check]) -> None:
    """Print the curves, and how well they predict rigs that they were not fitted to."""
    from rich.table import Table

    curves = Table("class", "IoU", "rigs", "objects", "individuals", "most", "rate a cell")
    left_out = Table(
        "class",
        "IoU",
        "Brier",
        "of the mean",
        "error",
        "spread",
        "ρ",
        "ρ, fitted",
        title="Rigs left out",
    )
    plain = Table("class", "IoU", "ln points", "5 points", "ln cells", title="ρ without a curve")
    for own in checks:
        name = (own.curve.object_class, f"{own.curve.iou:g}")
        numbers = (own.rigs, own.objects, own.individuals, own.curve.most, own.curve.rate)
        curves.add_row(*name, *map(str, numbers))
        left_out.add_row(
            *name,
            f"{own.brier:.4f}",
            f"{own.brier_of_mean:.4f}",
            *(f"{100 * share:.1f} %" for share in (own.error, own.spread)),
            *(f"{rho:+.2f}" for rho in (own.rho, own.rho_fitted)),
        )
        rhos = (own.rho_log_points, own.rho_enough_points, own.rho_log_cells)
        plain.add_row(*name, *(f"{rho:+.2f}" for rho in rhos))
    for table in (curves, left_out, plain):
        console.print(table)
    console.print(
        "error: mean distance of a rig's recall from the predicted one; spread: standard deviation "
        "of recall over the rigs; ρ: Spearman's with recall over the rigs, fitted: of the curve "
        "of all rigs"
    )
