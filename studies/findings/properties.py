"""What a rig of `findings.yaml` is, without any objects."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
from candidates import FOLDER

from lidarplace.mounting.ring_overlap import rings
from sweeps.configuration.grid import read_sweep


@cache
def properties() -> pd.DataFrame:
    """Index placement: lidars, beams, spinning, mean height, and the redundancy of its rings.

    Spinning: all LiDARs see all around. Redundancy is `lidarplace.mounting.ring_overlap`'s.
    """
    sweep = read_sweep(FOLDER / "findings.yaml")
    rigs = {one.point.placement: one.rig for one in sweep.points}.values()
    rows = [
        {
            "placement": rig.name,
            "lidars": len(rig.mounts),
            "beams": sum(lidar.beams for lidar in rig.lidars),
            "spinning": all(lidar.full_turn for lidar in rig.lidars),
            "mean height": float(np.mean([mount.z for mount in rig.mounts])),
            "redundancy": rings(rig).redundancy,
        }
        for rig in rigs
    ]
    return pd.DataFrame(rows).set_index("placement")
