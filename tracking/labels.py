"""Labels of figures and tables: names of surrogates, metrics and groups, and numbers."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from lidarplace.base.metrics import EVERY_IOU, METRICS
from lidarplace.pog.surrogates.table import SURROGATES

DASH = "–"  # in place of a missing number


def digits(value: float, form: str) -> str:
    """Format a number by Python's rules (`z`: no minus before zero); a dash for NaN."""
    if not np.isfinite(value):
        return DASH
    text = f"{value:{form}}"
    return "−" + text[1:] if text.startswith("-") else text


def known(value: float, error: float) -> str:
    """Format a number to the second digit of its error, thousands separated."""
    if not (np.isfinite(error) and error > 0):
        return number(value)
    decimals = 1 - int(np.floor(np.log10(error)))
    return digits(round(value, decimals), f"z,.{max(decimals, 0)}f")


def number(value: float) -> str:
    """Format five significant digits, thousands separated; what rounds to 0.00000000 is 0."""
    if abs(value) < 5e-9 or not np.isfinite(value):
        return digits(value, "z.0f")
    decimals = max(0, 4 - int(np.floor(np.log10(abs(value)))))
    return digits(value, f",.{min(decimals, 8)}f")


signed = partial(digits, form="+z.2f")  # a coefficient
points = partial(digits, form="+z.1f")  # a difference of percentages


def span(low: float, high: float, form: str) -> str:
    """Format a range such as "2.2 to 3.1"; a dash where there is no interval."""
    return f"{digits(low, form)} to {digits(high, form)}" if np.isfinite(low) else DASH


def not_significant(low: float, high: float) -> str:
    """Return the end of a sentence about a difference whose interval includes zero, else ""."""
    return ", not significant" if low <= 0 <= high else ""


def interval(low: float, high: float) -> str:
    """Format an interval of a coefficient in brackets; no width is no statement of precision."""
    return f"[{signed(low)}, {signed(high)}]" if high - low > 1e-9 else "[no interval]"


def plus_minus(mean: float, sd: float) -> str:
    """Format mean and standard deviation, "71.3 ± 0.9"; no ± for a single seed."""
    text = digits(mean, "z.1f")
    return text if np.isnan(mean) or np.isnan(sd) else f"{text} ± {sd:.1f}"


def percent(share: float) -> str:
    """Format a probability without false certainty."""
    if np.isnan(share):
        return DASH
    if share > 0.99:
        return "over 99 %"
    return "under 1 %" if share < 0.01 else f"{100 * share:.0f} %"


def surrogate_name(surrogate: str) -> str:
    """Return the display name; a surrogate that is not known here keeps its own."""
    return SURROGATES[surrogate].label if surrogate in SURROGATES else surrogate


def surrogate_short(surrogate: str) -> str:
    """Return the display name where there is little room."""
    short = SURROGATES[surrogate].short if surrogate in SURROGATES else ""
    return short or surrogate_name(surrogate)


def surrogate_unit(surrogate: str) -> str:
    """Return the unit, "" if it is not known here."""
    return SURROGATES[surrogate].unit if surrogate in SURROGATES else ""


def surrogate_label(surrogate: str) -> str:
    """Return display name and unit, for an axis."""
    name, unit = surrogate_name(surrogate), surrogate_unit(surrogate)
    return f"{name} ({unit})" if unit else name


def in_order(surrogates: Iterable[str]) -> list[str]:
    """Sort distinct surrogates in the order of display, unknown ones last."""
    distinct = list(dict.fromkeys(surrogates))
    return sorted(distinct, key=lambda name: [*SURROGATES, *distinct].index(name))


def some(names: Sequence[str]) -> str:
    """List five of many names at most, for a sentence."""
    more = len(names) - 5
    return ", ".join(names[:5]) + (f" and {more} more" if more > 0 else "")


def metric_name(metric: str) -> str:
    """Return the display name; a metric that is not known here keeps its own."""
    return METRICS[metric].label if metric in METRICS else metric


def metric_label(metric: str, iou: float) -> str:
    """Name a metric with its IoU, such as "BEV AP @ 0.7"; without it if it has no single IoU."""
    return metric_name(metric) if iou == EVERY_IOU else f"{metric_name(metric)} @ {iou:g}"


def setting_label(axes: Iterable[str], row: Mapping[Any, Any]) -> str:
    """Name values of further axes by the last part of the key path: "density = 40, lr = 0.001"."""
    return ", ".join(f"{axis.rsplit('.', 1)[-1]} = {row[axis]}" for axis in axes)


def detector_label(axes: Iterable[str], row: Mapping[Any, Any]) -> str:
    """Name detector and setting, for example "second, density = 40"."""
    return ", ".join(filter(None, (str(row["detector"]), setting_label(axes, row))))
