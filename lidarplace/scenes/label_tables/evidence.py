"""Evidence of motion on a label file's convention: axes of the vehicle, zero and sense of yaw."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from lidarplace.base.number_text import percent
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.convention import OUR_AXES, Convention, Sense, Zero
from lidarplace.scenes.label_tables.mapping import TableMapping
from lidarplace.scenes.sanity_checks.motion import (
    ACROSS,
    BACKWARDS,
    CLEARLY,
    LEAST_PASSING,
    LEAST_STEPS,
    MOST_ACROSS,
    MOST_ASIDE,
    axes_along_motion,
    shares_across,
)

ZEROS: tuple[Zero, ...] = ("x", "y")
SENSES: tuple[Sense, ...] = ("counterclockwise", "clockwise")
TURNED = 0.1  # share of headings off the axes from which the sense of yaw is of account


def convention_lines(log: BoxLog, mapping: TableMapping) -> Iterator[str]:
    """Yield the lines of a mapping on axes and yaw, by the log that `mapping` reads without them.

    What the values do not decide is an open key, see `TableMapping.candidates`."""
    axes, share, steps = axes_along_motion(log)
    along = "xy"[axes[1] in ("forward", "back")]
    why = f"the way along {along} is {percent(share)} of {steps} steps; a preview shows left and "
    why += "right"
    if steps < LEAST_PASSING or share < MOST_ASIDE:
        axes, why = OUR_AXES, f"no value tells another: {why if steps else 'nothing moves'}"
    keys = ", ".join(f"{axis}: {way}" for axis, way in zip("xyz", axes, strict=True))
    yield f"axes: {{{keys}}}   # {why}"
    if mapping.columns.yaw is None:
        return  # a rotation or a direction has its own sense
    ways = list(product(ZEROS, SENSES))
    conventions = [Convention.of(axes, zero, sense) for zero, sense in ways]
    across, back, steps = shares_across(log, conventions)
    best = int(np.argmin(across))
    if steps < LEAST_STEPS or across[best] >= across[0] / CLEARLY:
        best = 0  # not clearly another one
    zero, sense = ways[best]
    if back[best] > BACKWARDS:
        zero = "-x" if zero == "x" else "-y"
    other = best ^ 1  # the other sense
    why = f"of {steps} steps {percent(across[best])} are across the length, {ways[other][1]} "
    why = f"{why}{percent(across[other])}" if steps else "nothing moves"
    off_axes = np.abs(np.sin(2 * log.boxes["yaw"].to_numpy(np.float64))) > ACROSS
    undecided = steps < LEAST_STEPS or max(across[best], across[other]) < MOST_ACROSS
    if undecided and off_axes.mean() > TURNED:
        sense_text, why = "", "counterclockwise or clockwise, seen from above: --preview draws both"
    else:
        sense_text = sense
    yield f"yaw: {{zero: {zero}, sense: {sense_text}}}   # {why}"
