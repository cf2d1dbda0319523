"""How surrogates, metrics and groups of trials are called in figures and tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

SURROGATES: dict[str, tuple[str, str]] = {
    "s_mig": ("S-MIG", "nats"),
    "ig": ("IG", "nats"),
    "h_pog": ("H_POG", "nats"),
    "covered_entropy": ("covered entropy", "nats"),
    "residual_entropy": ("residual entropy", "nats"),
    "m_sog": ("M-SOG", "nats per voxel"),
    "expected_points": ("expected points", "points"),
    "expected_ig": ("expected IG", "nats"),
    "covered_voxels": ("covered voxels", "voxels"),
}
"""Name and unit of every surrogate, in the order of display."""

_METRICS = {
    "AP_R40_3D": "3D AP",
    "AP_R40_BEV": "BEV AP",
    "class_recall_3D": "recall of the class",
    "recall": "recall",
}


def surrogate_name(surrogate: str) -> str:
    """Display name; a surrogate that is not known here keeps its own."""
    return SURROGATES.get(surrogate, (surrogate, ""))[0]


def surrogate_label(surrogate: str) -> str:
    """Display name and unit, for an axis."""
    name, unit = SURROGATES.get(surrogate, (surrogate, ""))
    return f"{name} ({unit})" if unit else name


def in_order(surrogates: Iterable[str]) -> list[str]:
    """Distinct surrogates in the order of display, unknown ones last."""
    found = list(dict.fromkeys(surrogates))
    return sorted(found, key=lambda name: [*SURROGATES, *found].index(name))


def signed(value: float) -> str:
    """A coefficient with its sign and two decimals; zero has no minus."""
    return f"{round(value, 2) + 0.0:+.2f}".replace("-", "−")


def interval(low: float, high: float) -> str:
    """An interval of a coefficient in brackets; one of no width is no statement of precision."""
    return f"[{signed(low)}, {signed(high)}]" if high - low > 1e-9 else "[no interval]"


def some(names: Sequence[str], most: int = 5) -> str:
    """A few of many names, for a sentence."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def metric_label(metric: str, iou: float) -> str:
    """For example "BEV AP @ 0.7"."""
    return f"{_METRICS.get(metric, metric)} @ {iou:g}"


def setting_label(names: Iterable[str], values: Iterable[object]) -> str:
    """Values of further axes, for example "density = 40, lr = 0.001"; last part of the key path."""
    return ", ".join(
        f"{name.rsplit('.', 1)[-1]} = {value}" for name, value in zip(names, values, strict=True)
    )
