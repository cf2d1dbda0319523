"""Ground around the vehicle under rigs: expected recall, and recall of a sweep's detectors."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.own_body import sedan
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.recall_ground import HARDEST, RecallGround, recall_ground
from lidarplace.rigs.placement import Placement
from lidarplace.scenes.site import Poles
from lidarplace.studio.rigs_file import read_rigs
from tracking.figures.kit.rig_picture import PicturedRig
from tracking.findings.failures import Failures

FILE = "rigs.yaml"
"""File of a run folder with rigs, their LiDARs and their vehicle."""
MOST_GROUNDS = 2
"""Rigs with a coloured ground: the best and the second-best; each takes about a second."""
EDGE_M = 5.0
"""Edge of a cell in which detected objects are counted, metres."""
FEWEST = 10
"""Objects of a cell below which it has no colour."""
_BOTH_SIDES = np.array([-0.499, 0.499]) * EDGE_M


def with_grounds(
    rigs: Mapping[str, PicturedRig],
    placements: Mapping[str, Placement],
    vehicle: Vehicle,
    classes: Collection[str],
) -> dict[str, PicturedRig]:
    """Add the expected ground to the first `MOST_GROUNDS` rigs that are among the placements.

    Of the class that is hardest to find; without one of `HARDEST`, rigs stay as they are."""
    pictured, hardest = dict(rigs), next((name for name in HARDEST if name in classes), None)
    if hardest is None:
        return pictured
    for name in [name for name in rigs if name in placements][:MOST_GROUNDS]:
        ground = recall_ground(placements[name], vehicle, hardest)
        pictured[name] = replace(rigs[name], ground=ground)
    return pictured


def with_grounds_of_folder(
    rigs: Mapping[str, PicturedRig], folder: Path, classes: Collection[str], body: Vehicle | None
) -> dict[str, PicturedRig]:
    """Add grounds to rigs of a run folder's `FILE`; without the file, they stay as they are.

    `body` is drawn; that of the file hides the ground, at a site the buildings."""
    if not (folder / FILE).exists():
        return dict(rigs)
    read = read_rigs(folder / FILE)
    placements = {rig.name: rig.placement(read.lidar) for rig in read.rigs}
    with_lidars = {name: rig for name, rig in placements.items() if rig is not None}
    hiding = body.with_walls if isinstance(body, Poles) else read.carrier or sedan()
    return with_grounds(rigs, with_lidars, hiding, classes)


def detected_grounds(failures: Failures) -> dict[str, RecallGround]:
    """Compute the share of the objects in each cell that the detectors of two rigs found.

    Means over seeds, in cells of `EDGE_M` with `FEWEST` objects or more; others are NaN. None if no
    cell has as many."""
    at = np.floor(failures.objects[["x", "y"]].to_numpy(np.float64) / EDGE_M).astype(np.int64)
    low, cells = at.min(axis=0), at - at.min(axis=0)
    shape = cells.max(axis=0) + 1
    place = np.ravel_multi_index(tuple(cells.T), tuple(shape))
    counts = np.bincount(place, minlength=shape.prod())
    x, y = (
        ((low[axis] + np.arange(shape[axis]) + 0.5)[:, None] * EDGE_M + _BOTH_SIDES).ravel()
        for axis in range(2)
    )
    grounds: dict[str, RecallGround] = {}
    if counts.max(initial=0) < FEWEST:
        return grounds
    for rig, shares in zip(failures.rigs, failures.shares, strict=True):
        hits = np.bincount(place, shares, minlength=len(counts))
        recall = np.divide(hits, counts, out=np.full(len(counts), np.nan), where=counts >= FEWEST)
        values = np.kron(recall.reshape(shape), np.ones((2, 2)))
        grounds[rig] = RecallGround("object", x, y, values, values, dead=None)
    return grounds


def ground_note(rigs: Mapping[str, PicturedRig]) -> str:
    """Describe the colours of the ground under rigs, and its mean; "" without a ground."""
    parts, classes = [], set()
    for name, rig in rigs.items():
        if (ground := rig.ground) is None:
            continue
        classes.add(ground.object_class)
        parts.append(f"{name} {_percent(ground.built)}")
        if ground.dead is not None:
            parts[-1] += f" ({_percent(ground.degraded)} with LiDAR {ground.dead + 1} dead)"
    if not parts:
        return ""
    note = (
        f"Colours of the ground: the chance that a detector finds a single {' or '.join(classes)} "
        f"there, by the detection curves of the package. Means: {', '.join(parts)}; the dead LiDAR "
        "is the one that costs most."
    )
    if any(rig.ground and rig.ground.takes_time for rig in rigs.values()):
        note += " They ignore rate_hz."
    if any(rig.detected for rig in rigs.values()):
        note += (
            f" As detected: the share of the test objects that were found, in cells of {EDGE_M:g} "
            f"m with {FEWEST} or more."
        )
    return note


def _percent(chances: NDArray[np.float64]) -> str:
    return f"{100 * np.nanmean(chances):.1f} %"
