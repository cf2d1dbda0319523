"""Numbers as text, for lines and titles."""


def span(values: list[float]) -> str:
    """Format a range of numbers, such as "2.2" or "-0.6 to 0.6"."""
    low, high = number(min(values), 3), number(max(values), 3)
    return low if low == high else f"{low} to {high}"


def number(value: float, digits: int = 6) -> str:
    """Round to `digits`, without negative zero."""
    return f"{round(float(value), 9) + 0.0:.{digits}g}"


def point(*coordinates: float) -> str:
    """Format a point, such as (0, 1.5, 2)."""
    return f"({', '.join(map(number, coordinates))})"


def percent(share: float, form: str = ".0f") -> str:
    """Format a share in percent, such as "5 %" or "−0.3 %"."""
    return f"{100 * share:{form}} %".replace("-", "−")
