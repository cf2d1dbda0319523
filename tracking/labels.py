"""How surrogates, metrics and groups of trials are called in figures and tables."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lidarplace.base.metrics import EVERY_IOU, METRICS
from lidarplace.pog.surrogates.table import SURROGATES


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
    """For example "BEV AP @ 0.7"; of a metric that is of no single IoU its name alone."""
    return metric_name(metric) if iou == EVERY_IOU else f"{metric_name(metric)} @ {iou:g}"


def setting_label(axes: Iterable[str], row: Mapping[Any, Any]) -> str:
    """Values of further axes, for example "density = 40, lr = 0.001"; last part of the key path."""
    return ", ".join(f"{axis.rsplit('.', 1)[-1]} = {row[axis]}" for axis in axes)


def detector_label(axes: Iterable[str], row: Mapping[Any, Any]) -> str:
    """Detector and setting, for example "second, density = 40"."""
    return ", ".join(filter(None, (str(row["detector"]), setting_label(axes, row))))
