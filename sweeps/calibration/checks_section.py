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
    """Show the curves, and how well they predict rigs, routes and objects that were left out."""
    rows = pd.DataFrame([{**vars(check), **vars(check.curve)} for check in checks])
    parts = (
        (check.curve, unit, errors) for check in checks for unit, errors in check.left_out.items()
    )
    left_out = pd.DataFrame(
        [{**vars(check), "unit": u, **vars(errors)} for check, u, errors in parts]
    )
    counts = [numbers(name, name, ",") for name in ("rigs", "objects", "individuals")]
    shape = [numbers("most", "most", "g"), numbers("rate a cell", "rate", "g")]
    tables = [Table.of("Detection curves", rows, [*_NAME, *counts, *shape])]
    if len(left_out):
        columns = [
            words("left out", "unit"),
            numbers("parts", "parts", ","),
            numbers("Brier", "brier", ".4f"),
            numbers("of the mean", "brier_of_mean", ".4f"),
            *(numbers(f"{name} (%)", name, _percent) for name in ("error", "spread")),
        ]
        tables.append(Table.of("Left out", left_out, [*_NAME, *columns]))
    notes = [
        "error: mean distance of the recall of a part from the predicted one; spread: standard "
        "deviation of recall over the parts. A Brier score below that of the mean: the curve "
        "predicts better than the share of all objects that are found."
    ]
    if any(check.rigs > 1 for check in checks):
        columns = [numbers(head, key, "+.2f") for head, key in _RHOS.items()]
        tables.append(Table.of("Order of the rigs by recall", rows, [*_NAME, *columns]))
        notes.append(
            "ρ: Spearman's with recall over the rigs, each left out; fitted: of the curve of all "
            "rigs; the last three are without a curve."
        )
    else:
        notes.insert(
            0, "One rig: none can be left out, so how other rigs are predicted is unknown."
        )
    return Section("Detection curves", notes, tables=tables, columns=1)


def _percent(share: float) -> str:
    return f"{100 * share:.1f}"
