"""Quality of detection curves, as tables of a page and of the terminal."""

from collections.abc import Sequence

import pandas as pd

from sweeps.calibration.left_out import Check
from tracking.pages.section import Section, Table, numbers, words

_NAME = [words("class", "object_class"), numbers("IoU", "iou", "g")]
_RHOS = {
    "ρ": "rho",
    "ρ, fitted": "rho_fitted",
    "ln points": "rho_log_points",
    "5 points": "rho_enough_points",
    "ln cells": "rho_log_cells",
}


def checks_section(checks: Sequence[Check]) -> Section:
    """Show how well the curves predict rigs, routes and objects that were left out of their fit."""
    rows = pd.DataFrame([{**vars(check), **vars(check.curve)} for check in checks])
    parts = (
        (check.curve, unit, errors) for check in checks for unit, errors in check.left_out.items()
    )
    left_out = pd.DataFrame(
        [{**vars(check), "unit": u, **vars(errors)} for check, u, errors in parts]
    )
    counts = [numbers(name, name, ",") for name in ("rigs", "objects", "individuals")]
    shape = [numbers("most", "most", ".3g"), numbers("rate per cell", "rate", ".3g")]
    tables = [Table.of("Fit", rows, [*_NAME, *counts, *shape])]
    if len(left_out):
        columns = [
            words("left out", "unit"),
            numbers("parts", "parts", ","),
            numbers("Brier", "brier", ".4f"),
            numbers("Brier of the mean", "brier_of_mean", ".4f"),
            *(numbers(f"{name} (%)", name, _percent) for name in ("error", "spread")),
        ]
        tables.append(Table.of("Left out", left_out, [*_NAME, *columns]))
    notes = [
        "Error: mean difference of measured and predicted recall over the parts left out. Spread: "
        "standard deviation of recall over the parts. A Brier score below that of the mean: the "
        "curve predicts better than one recall for all objects."
    ]
    if any(check.rigs > 1 for check in checks):
        columns = [numbers(head, key, "+.2f") for head, key in _RHOS.items()]
        tables.append(Table.of("Order of the rigs by recall", rows, [*_NAME, *columns]))
        notes.append(
            "ρ: Spearman's rank correlation with the measured recall of the rigs. Each rig is left "
            "out of the fit; “fitted”: the curve of all rigs. The last three need no curve."
        )
    else:
        notes.insert(0, "One rig: none can be left out, so the error for other rigs is unknown.")
    return Section("Check of the curves", notes, tables=tables, columns=1)


def _percent(share: float) -> str:
    return f"{100 * share:.1f}"
