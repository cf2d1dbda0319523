"""Whether a rig sits at the edge of what the search was allowed to try."""

from __future__ import annotations

import numpy as np

from tracking.run_folders.search_json import Rig, Zone

_NEAR = 0.005
"""Metres: nearer to the face of a zone than any bracket is mounted."""
_SHARE = 0.01
"""Of the span of an angle."""


def at_the_edge(rig: Rig, zones: tuple[Zone, ...]) -> list[str]:
    """What of the rig lies at the edge, for example "LiDAR 2: z, roll".

    LiDARs outside of `zones` were not searched, or are mirror images of one within. A range without
    width has no edge, and neither has a full turn.
    """
    by_name = {zone.name: zone for zone in zones}
    found = []
    for i, (mount, name) in enumerate(zip(rig.placed, rig.zones, strict=True), start=1):
        zone = by_name.get(name or "")
        if zone is None or mount.y < min(y for _, y in zone.polygon) - _NEAR:
            continue
        edges = _of_zone(mount.x, mount.y, mount.z, zone)
        edges += [
            angle
            for angle in ("roll", "pitch", "yaw")
            if _extreme(np.degrees(getattr(mount, angle)), getattr(zone, f"{angle}_deg"))
        ]
        if edges:
            found.append(f"LiDAR {i}: {', '.join(edges)}")
    return found


def _of_zone(x: float, y: float, z: float, zone: Zone) -> list[str]:
    corners = np.array(zone.polygon)
    following = np.roll(corners, -1, axis=0)
    area = corners[:, 0] @ following[:, 1] - corners[:, 1] @ following[:, 0]
    found = []
    if abs(area) > 1e-9 and _distance(np.array([x, y]), corners, following) < _NEAR:
        found.append("x, y")
    low, high = zone.z
    if high > low and min(abs(z - low), abs(z - high)) < _NEAR:
        found.append("z")
    return found


def _distance(point: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> float:
    """From a point (2,) to the nearest of segments (n, 2), metres."""
    along = ends - starts
    length = np.maximum((along**2).sum(axis=1), 1e-18)
    t = np.clip(((point - starts) * along).sum(axis=1) / length, 0, 1)
    return float(np.linalg.norm(starts + t[:, None] * along - point, axis=1).min())


def _extreme(degrees: float, span: tuple[float, float]) -> bool:
    low, high = span
    if not low < high < low + 360:
        return False
    off = abs((degrees - (low + high) / 2 + 180) % 360 - 180)  # from the middle, either way round
    return off > (0.5 - _SHARE) * (high - low)
