"""Ground around the vehicle under rigs: computed from the file that the studio opens."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.own_body import sedan
from lidarplace.requirements.recall_ground import recall_ground
from lidarplace.studio.rigs_file import read_rigs
from tracking.figures.kit.rig_picture import PicturedRig

FILE = "rigs.yaml"
"""File of a run folder with rigs, their LiDARs and their vehicle."""
MOST_GROUNDS = 2
"""Rigs with a coloured ground: the best and the second-best; each takes about a second."""


def with_grounds(
    rigs: Mapping[str, PicturedRig], folder: Path, classes: Collection[str]
) -> dict[str, PicturedRig]:
    """Add the ground to the first `MOST_GROUNDS` rigs of a run folder's `FILE`.

    Rigs that it does not have, and those of older folders without it, stay as they are."""
    if not (folder / FILE).exists():
        return dict(rigs)
    read = read_rigs(folder / FILE)
    named, pictured = {rig.name: rig for rig in read.rigs}, dict(rigs)
    for name in [name for name in rigs if name in named][:MOST_GROUNDS]:
        placement = named[name].placement(read.lidar)
        if placement is not None:
            ground = recall_ground(placement, read.carrier or sedan(), classes)
            pictured[name] = replace(rigs[name], ground=ground)
    return pictured


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
    return (
        f"Colours of the ground: the chance that a detector finds a single {' or '.join(classes)} "
        f"there, by the detection curves of the package. Means: {', '.join(parts)}; the dead LiDAR "
        "is the one that costs most."
    )


def _percent(chances: NDArray[np.float64]) -> str:
    return f"{100 * np.nanmean(chances):.1f} %"
