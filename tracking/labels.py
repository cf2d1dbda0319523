"""Labels of figures and tables: names of surrogates, metrics and groups, and numbers."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from lidarplace.base.metrics import EVERY_IOU, METRICS
from lidarplace.pog.surrogates.table import SURROGATES

DASH = "–"  # in place of a missing number


def digits(value: float, form: str) -> str:
    """A number in a format of Python's, in which `z` keeps zero from having a minus."""
    if not np.isfinite(value):
        return DASH
    text = f"{value:{form}}"
    return "−" + text[1:] if text.startswith("-") else text


def number(value: float) -> str:
    """Five significant digits, thousands separated."""
    if value == 0 or not np.isfinite(value):
        return digits(value, "z.0f")
    decimals = max(0, 4 - int(np.floor(np.log10(abs(value)))))
    return digits(value, f",.{min(decimals, 8)}f")


signed = partial(digits, form="+z.2f")  # a coefficient
points = partial(digits, form="+z.1f")  # a difference of percentages


def span(low: float, high: float, form: str) -> str:
    """From `low` to `high`; a dash where there is no interval."""
    return f"{digits(low, form)} to {digits(high, form)}" if np.isfinite(low) else DASH


def not_significant(low: float, high: float) -> str:
    """What ends the sentence of a difference whose interval this is, "" where zero is not in it."""
    return ", not significant" if low <= 0 <= high else ""


def interval(low: float, high: float) -> str:
    """An interval of a coefficient in brackets; one of no width is no statement of precision."""
    return f"[{signed(low)}, {signed(high)}]" if high - low > 1e-9 else "[no interval]"


def plus_minus(mean: float, sd: float) -> str:
    """Mean and standard deviation, "71.3 ± 0.9"; no ± for a single seed."""
    shown = digits(mean, "z.1f")
    return shown if np.isnan(mean) or np.isnan(sd) else f"{shown} ± {sd:.1f}"


def percent(share: float) -> str:
    """A probability without false certainty."""
    if np.isnan(share):
        return DASH
    if share > 0.99:
        return "over 99 %"
    return "under 1 %" if share < 0.01 else f"{100 * share:.0f} %"


def surrogate_name(surrogate: str) -> str:
    """Display name; a surrogate that is not known here keeps its own."""
    return SURROGATES[surrogate].label if surrogate in SURROGATES else surrogate


def surrogate_short(surrogate: str) -> str:
    """Display name where there is little room."""
    return SURROGATES[surrogate].short or surrogate_name(surrogate)


def surrogate_unit(surrogate: str) -> str:
    """Unit, "" if it is not known here."""
    return SURROGATES[surrogate].unit if surrogate in SURROGATES else ""


def surrogate_label(surrogate: str) -> str:
    """Display name and unit, for an axis."""
    name, unit = surrogate_name(surrogate), surrogate_unit(surrogate)
    return f"{name} ({unit})" if unit else name


def in_order(surrogates: Iterable[str]) -> list[str]:
    """Distinct surrogates in the order of display, unknown ones last."""
    found = list(dict.fromkeys(surrogates))
    return sorted(found, key=lambda name: [*SURROGATES, *found].index(name))


def some(names: Sequence[str]) -> str:
    """Five of many names at most, for a sentence."""
    more = len(names) - 5
    return ", ".join(names[:5]) + (f" and {more} more" if more > 0 else "")


def metric_name(metric: str) -> str:
    """Display name; a metric that is not known here keeps its own."""
    return METRICS[metric].label if metric in METRICS else metric


def metric_label(metric: str, iou: float) -> str:
    """For example "BEV AP @ 0.7"; of a metric without a single IoU its name alone."""
    return metric_name(metric) if iou == EVERY_IOU else f"{metric_name(metric)} @ {iou:g}"


def setting_label(axes: Iterable[str], row: Mapping[Any, Any]) -> str:
    """Values of further axes, for example "density = 40, lr = 0.001"; last part of the key path."""
    return ", ".join(f"{axis.rsplit('.', 1)[-1]} = {row[axis]}" for axis in axes)


def detector_label(axes: Iterable[str], row: Mapping[Any, Any]) -> str:
    """Detector and setting, for example "second, density = 40"."""
    return ", ".join(filter(None, (str(row["detector"]), setting_label(axes, row))))
