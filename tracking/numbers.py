"""Numbers as text: a true minus, none for zero, a dash where there is no number."""

import numpy as np

DASH = "–"
"""What stands where there is no number."""


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


def signed(value: float) -> str:
    """A coefficient with its sign and two decimals."""
    return digits(value, "+z.2f")


def points(value: float) -> str:
    """A difference of percentages with its sign and one decimal."""
    return digits(value, "+z.1f")


def span(low: float, high: float, form: str) -> str:
    """From `low` to `high`; a dash where there is no interval."""
    return f"{digits(low, form)} to {digits(high, form)}" if np.isfinite(low) else DASH


def interval(low: float, high: float) -> str:
    """An interval of a coefficient in brackets; one of no width is no statement of precision."""
    return f"[{signed(low)}, {signed(high)}]" if high - low > 1e-9 else "[no interval]"


def plus_minus(mean: float, sd: float) -> str:
    """Mean and standard deviation, "71.3 ± 0.9"; no ± for a single seed."""
    shown = digits(mean, "z.1f")
    return shown if np.isnan(mean) or np.isnan(sd) else f"{shown} ± {sd:.1f}"


def percent(share: float) -> str:
    """A probability without false certainty."""
    if share > 0.99:
        return "over 99 %"
    return "under 1 %" if share < 0.01 else f"{100 * share:.0f} %"
