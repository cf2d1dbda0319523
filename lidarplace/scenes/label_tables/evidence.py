"""Evidence of motion on a label file's convention: axes of the vehicle, zero and sense of yaw."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from lidarplace.base.number_text import percent
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, frame_ids
from lidarplace.logs.convention import OUR_AXES, Convention, Sense, Zero, anchor_of
from lidarplace.scenes.label_tables.mapping import OR, TableMapping
from lidarplace.scenes.sanity_checks.motion import (
    ACROSS,
    BACKWARDS,
    CLEARLY,
    LEAST_PASSING,
    LEAST_STEPS,
    MOST_ACROSS,
    MOST_ASIDE,
    MOST_BOXES,
    axes_along_motion,
    shares_across,
)

ZEROS: tuple[Zero, ...] = ("x", "y")
SENSES: tuple[Sense, ...] = ("counterclockwise", "clockwise")
LEAST_PAIRS = 5  # different pairs of vehicles that overlap are no mistake of a label
VEHICLE_M = 3.0  # shorter boxes hardly move from one reference point to another
REACH_M = 20.0  # boxes farther apart are not compared
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


def anchor_line(log: BoxLog, anchor: str) -> str:
    """Return the line of an anchor at a side or corner; empty where hardly a vehicle overlaps.

    Real vehicles do not overlap, so boxes that do are placed by another point than their centre. Of
    points that fit alike two are candidates, see `TableMapping.candidates`."""
    words = [
        " ".join(pair).strip() for pair in product(("", "rear", "front"), ("", "left", "right"))
    ]
    pairs = {word: _overlapping(log, word) for word in words}
    at_centre = pairs.pop("")
    best, second = sorted(pairs, key=lambda word: pairs[word])[:2]
    if at_centre < LEAST_PAIRS or pairs[best] * CLEARLY > at_centre:
        return ""
    upright = "" if anchor == "centre" else f" {anchor}"
    why = f"{at_centre} pairs of vehicles overlap with {anchor}, {pairs[best]} with {best}"
    anchors = f"{best}{upright}"
    if pairs[second] < CLEARLY * max(pairs[best], 1):
        anchors, why = f"{anchors}{OR}{second}{upright}", f"{why}, {pairs[second]} with {second}"
        why += ": --preview draws both"
    return f"anchor: {anchors}   # {why}"


def _overlapping(log: BoxLog, anchor: str) -> int:
    """Count pairs of vehicles that overlap in some frame if `anchor` is at the boxes' centres."""
    boxes = log.boxes[log.boxes["length"] > VEHICLE_M].iloc[:MOST_BOXES]
    if boxes.empty:
        return 0
    x, y, _, length, width, _, yaw = boxes[list(GEOMETRY)].to_numpy(np.float64).T
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, aside, _ = anchor_of(anchor or "centre")
    x = x - (cos * ahead * length - sin * aside * width)
    y = y - (sin * ahead * length + cos * aside * width)
    apart = np.column_stack([x, y, 2 * REACH_M * frame_ids(boxes)])
    one, other = cKDTree(apart).query_pairs(REACH_M, output_type="ndarray").T
    overlap = np.ones(len(one), bool)
    for a, b in ((one, other), (other, one)):
        dx, dy, turn = x[b] - x[a], y[b] - y[a], yaw[b] - yaw[a]
        c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        along, across = cos[a] * dx + sin[a] * dy, cos[a] * dy - sin[a] * dx
        overlap &= 2 * np.abs(along) < length[a] + c * length[b] + s * width[b]
        overlap &= 2 * np.abs(across) < width[a] + s * length[b] + c * width[b]
    ids = boxes.groupby(["scene", "object_id"], sort=False).ngroup().to_numpy()
    pairs = np.sort(np.column_stack([ids[one], ids[other]])[overlap], axis=1)
    return len(np.unique(pairs, axis=0))
