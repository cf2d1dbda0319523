"""HTML of the panel: numbers, violations and answers."""

import html
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from lidarplace.studio.numbers import Numbers
from lidarplace.studio.studio import Studio
from lidarplace.studio.violations import ReportedViolation
from lidarplace.studio.why_unseen import AimedRays

DASH = "–"

Row = tuple[str, float, float | None, str]
"""Label, value, initial value if there is one, and their format."""

_STYLE = "font-size:0.85em; line-height:1.35; padding:0.2em 1em 0.2em 0.6em"
_APART = "padding-bottom:0.8em"  # from the tabs that follow
_CELL = "text-align:right; white-space:nowrap; padding-left:0.5em"


def numbers_table(
    now: Numbers, initial: Numbers, h_pog: Mapping[str, float], others: Sequence[Row]
) -> str:
    """Return values, and the difference to the initial rig; `h_pog` is by class, nats."""
    total = sum(h_pog.values()) or math.nan
    shares = [100 * sum(numbers.covered_entropy.values()) / total for numbers in (now, initial)]
    rows: list[Row] = [
        ("S-MIG, nats", sum(now.s_mig.values()), sum(initial.s_mig.values()), ",.2f"),
        ("Covered entropy, %", shares[0], shares[1], ".2f"),
    ]
    rows += [
        (f"Expected recall {name}", value, initial.expected_recall[name], ".4f")
        for name, value in now.expected_recall.items()
    ]
    body = "".join(_row(*row) for row in [*rows, *others])
    state = "exact" if now.exact else "moving: fewer rays"
    head = f'<tr><td style="opacity:0.6">{state}</td>' + "".join(
        f'<td style="{_CELL}; opacity:0.6">{name}</td>' for name in ("now", "change")
    )
    return (
        f'<div style="{_STYLE}" data-exact="{str(now.exact).lower()}">'
        f'<table style="width:100%; border-collapse:collapse">{head}</tr>{body}</table></div>'
    )


def _row(label: str, now: float, initial: float | None, form: str) -> str:
    change = DASH if initial is None else _text(now - initial, f"+z{form}")
    key = label.partition(",")[0].lower().replace(" ", "-")
    return (
        f'<tr data-row="{html.escape(key)}"><td>{html.escape(label)}</td>'
        f'<td style="{_CELL}"><b>{_text(now, f"z{form}")}</b></td>'
        f'<td style="{_CELL}">{change}</td></tr>'
    )


def _text(value: float, form: str) -> str:
    return f"{value:{form}}".replace("-", "−") if math.isfinite(value) else DASH


def _box(body: str, more: str = "") -> str:
    return f'<div style="{_STYLE}{more}">{body}</div>'


def _lines(texts: Iterable[str]) -> str:
    return "".join(f"<div>{html.escape(text)}</div>" for text in texts)


def left_out_message(studio: Studio) -> str:
    """Name the classes of the log that have no numbers."""
    return (
        f"classes of the log in no number, sweep or evaluation: {', '.join(studio.left_out)}; "
        f"expected {', '.join(studio.classes)}"
    )


def violations_list(violations: Sequence[ReportedViolation]) -> str:
    """List what is violated, or say that all constraints are kept."""
    if not violations:
        return _box("✓ all constraints are met", f"; {_APART}; color:#2b8a3e")
    return _box(
        _lines(f"✗ {violation.text}" for violation in violations), f"; {_APART}; color:#c92a2a"
    )


def unseen_list(objects: pd.DataFrame) -> str:
    """Count the objects of a frame that count and that no LiDAR sees, and name them."""
    unseen = objects[objects["points"] == 0]
    text = f"{len(unseen)} of {len(objects)} objects that count are seen by no LiDAR"
    if len(unseen):
        text += ": " + ", ".join(map(str, unseen["object_id"]))
    return _box(html.escape(text))


def object_answer(objects: pd.DataFrame, chosen: str, rays: Sequence[AimedRays]) -> str:
    """Describe what is seen of an object, and what happens to rays that aim at it, by LiDAR."""
    rows = objects[objects["object_id"].astype(str) == chosen]
    lines = [
        "It does not count: an ideal sensor on the roof does not see it, or it is outside of the "
        "ROI."
    ]
    if len(rows):
        row = rows.iloc[0]
        away = float(np.hypot(row["x"], row["y"]))
        lines = [
            f"{row['class']}, {away:.1f} m away: {row['points']:,} points on {row['cells']:,} "
            f"cells, found with probability {row['probability']:.2f}."
        ]
    return _box(_lines([*lines, *(f"LiDAR {n}: {one.text}." for n, one in enumerate(rays, 1))]))


def evaluation_tables(results: Mapping[str, pd.DataFrame]) -> str:
    """Return AP and recall of each rig, from `found_by_sweep`, with their intervals."""
    rows = []
    for metric, table in results.items():
        rows.append(f'<tr><td colspan="2" style="opacity:0.6">{html.escape(metric)}, %</td></tr>')
        for name, row in table.sort_values("mean", ascending=False).iterrows():
            mean, low, high = (_text(float(row[end]), ".1f") for end in ("mean", "low", "high"))
            rows.append(
                f"<tr><td>{html.escape(str(name))}</td>"
                f'<td style="{_CELL}"><b>{mean}</b> ({low} to {high})</td></tr>'
            )
    return _box(f'<table style="width:100%; border-collapse:collapse">{"".join(rows)}</table>')


def progress(lines: Sequence[str]) -> str:
    """Return the last lines that a command printed."""
    return _box(_lines(lines or ["starts …"]), "; font-family:monospace; overflow-wrap:anywhere")


def message(text: str, good: bool = True) -> str:
    """Return a line of the page for the person."""
    return _box(html.escape(text), f"; color:{'inherit' if good else '#c92a2a'}")
