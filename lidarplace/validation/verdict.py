"""May the simulator be believed for this vehicle?"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lidarplace.validation.fit import FEWEST_TRACKS
from lidarplace.validation.validation import Validation

BIAS = 0.1
"""Largest median of log2(simulated / real) of all objects: 7 %."""
SPREAD = 0.5
"""Largest median of its absolute value. A real object against itself in the next frame has 0.12."""
WITHIN_2 = 0.75
"""Least share of objects within a factor 2."""
RHO = 0.85
"""Least Spearman's rho over objects."""
SHARE = 0.05
"""Largest difference of the shares of objects with at least 5 points."""


@dataclass(frozen=True)
class Verdict:
    """The decision of the page.

    Attributes:
        answer: "yes", "with a correction" or "no".
        why: sentences.
    """

    answer: str
    why: tuple[str, ...]


def verdict(found: Validation) -> Verdict:
    """Decide by the simulation as shipped, and by the correction on routes left out of its fit."""
    if found.tracks < FEWEST_TRACKS:
        few = (
            f"Too few tracks to judge; expected at least {FEWEST_TRACKS}, found {found.tracks}. "
            "One number was fitted: a factor for all classes."
        )
        return Verdict("no", (few,))
    failed = {model: _failed(_all(found, model)) for model in ("shipped", "corrected")}
    if not failed["shipped"]:
        return Verdict("yes", ("Without a correction every check is met.",))
    why = [f"As shipped: {'; '.join(failed['shipped'])}."]
    if not found.given and found.routes < 2:
        why.append("There is one route: a correction cannot be judged on another one.")
        return Verdict("no", tuple(why))
    if failed["corrected"]:
        why.append(f"With the correction: {'; '.join(failed['corrected'])}.")
        return Verdict("no", tuple(why))
    how = (
        "as given"
        if found.given
        else f"judged on {found.routes} routes left out of the fit in turn"
    )
    why.append(f"With the correction, {how}, every check is met.")
    if found.given and _fitted_here(found):
        why.append("The correction was fitted to this very log: judge it on another one.")
    of_routes = found.scores.query("model == 'corrected' and by == 'route'")["bias"]
    if len(of_routes) > 1:
        low, high = 2 ** of_routes.min(), 2 ** of_routes.max()
        why.append(
            f"On single routes the median object has {low:.2f} to {high:.2f} times its real points."
        )
    return Verdict("with a correction", tuple(why))


def _fitted_here(found: Validation) -> bool:
    """Whether a given correction states the routes, tracks and boxes of this log."""
    facts = found.correction.fitted
    own = {"routes": found.routes, "tracks": found.tracks, "boxes": found.boxes}
    return own.items() <= facts.items()


def _all(found: Validation, model: str) -> Mapping[Any, float]:
    rows = found.scores[(found.scores["model"] == model) & (found.scores["by"] == "all")]
    return rows.iloc[0].to_dict()


def _failed(row: Mapping[Any, float]) -> list[str]:
    """Checks that are not met, in words."""
    share = row["simulated_5"] - row["real_5"]
    checks = (
        abs(row["bias"]) <= BIAS
        or f"the median object has {2 ** row['bias']:.2f} times its real points",
        row["spread"] <= SPREAD
        or f"half of the objects are off by more than a factor {2 ** row['spread']:.2f}",
        row["within_2"] >= WITHIN_2 or f"{row['within_2']:.0%} of objects are within a factor 2",
        row["rho"] >= RHO or f"the rank correlation over objects is {row['rho']:.2f}",
        abs(share) <= SHARE
        or f"the share of objects with at least 5 points is off by {share:+.1%}",
    )
    return [words for words in checks if isinstance(words, str)]
