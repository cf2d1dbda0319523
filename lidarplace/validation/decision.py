"""Decision whether the simulator can be trusted for a vehicle."""

import math
from typing import NamedTuple

from lidarplace.base.number_text import number, percent
from lidarplace.validation.fit import FEWEST_TRACKS
from lidarplace.validation.validation import Validation

BIAS = 0.1  # largest median of log2(simulated / real) of all objects: 7 %
SPREAD = 0.5
"""Largest median of its absolute value. A real object against itself in the next frame has 0.12."""
WITHIN_2 = 0.75  # least share of objects within a factor 2
RHO = 0.85  # least Spearman's rho over objects
SHARE = 0.05  # largest difference of the shares of objects with at least 5 points


class Decision(NamedTuple):
    """Decision of the page, and its reasons."""

    answer: str  # "yes", "with a correction" or "no"
    why: tuple[str, ...]


def decide(validation: Validation) -> Decision:
    """Decide by the simulation as shipped, and by the correction on routes left out of its fit."""
    if validation.tracks < FEWEST_TRACKS:
        few = f"Too few tracks to evaluate; expected at least {FEWEST_TRACKS}, found "
        few += f"{validation.tracks}. One number was fitted: a factor for all classes."
        return Decision("no", (few,))
    failed = {model: _failed(validation, model) for model in ("shipped", "corrected")}
    if not failed["shipped"]:
        return Decision("yes", ("Without a correction every check is met.",))
    why = [f"As shipped: {'; '.join(failed['shipped'])}."]
    if not validation.correction_given and validation.routes < 2:
        why.append("There is one route: a correction cannot be evaluated on another one.")
        return Decision("no", tuple(why))
    if failed["corrected"]:
        why.append(f"With the correction: {'; '.join(failed['corrected'])}.")
        return Decision("no", tuple(why))
    basis = f"evaluated on {validation.routes} routes left out of the fit in turn"
    basis = "as given" if validation.correction_given else basis
    why.append(f"With the correction, {basis}, every check is met.")
    facts = {"routes": validation.routes, "tracks": validation.tracks, "boxes": validation.boxes}
    if validation.correction_given and facts.items() <= validation.correction.fitted.items():
        why.append("The correction was fitted to this log: evaluate it on another one.")
    of_routes = validation.scores.query("model == 'corrected' and by == 'route'")["bias"]
    if len(of_routes) > 1:
        low, high = 2 ** of_routes.min(), 2 ** of_routes.max()
        why.append(
            f"On single routes the median object has {low:.2f} to {high:.2f} times its real points."
        )
    return Decision("with a correction", tuple(why))


def _failed(validation: Validation, model: str) -> list[str]:
    row = validation.scores.query("model == @model and by == 'all'").iloc[0]
    bias, spread, within, rho = row[["bias", "spread", "within_2", "rho"]]
    if math.isnan(bias):
        return ["no object has 5 simulated points"]
    share = row["simulated_5"] - row["real_5"]
    checks = {
        f"the median object has {2**bias:.2f} times its real points": abs(bias) <= BIAS,
        f"half of the objects are off by more than a factor {2**spread:.2f}": spread <= SPREAD,
        f"{percent(within)} of objects are within a factor 2": within >= WITHIN_2,
        f"the rank correlation over objects is {number(rho, 2)}": rho >= RHO,
        f"the share of objects with at least 5 points is off by {percent(share, '+.1f')}": (
            abs(share) <= SHARE
        ),
    }
    return [words for words, met in checks.items() if not met]
