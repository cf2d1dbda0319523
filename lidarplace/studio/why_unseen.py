"""Why is an object not seen, or hardly: what becomes of the rays that aim at it."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.raycast import cast, expected_share
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.clouds.shapes import BODY, BUILDING, PANE, SIGN, WORLD, Parts
from lidarplace.clouds.static_world import cast_in_world
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement
from lidarplace.viewing.frame import Frame

NAMES = {
    BODY: "the vehicle itself",
    BUILDING: "a building",
    SIGN: "a sign",
    WORLD: "what stands still and has no label",
}
"""Of what stops rays, besides objects and the ground."""


@dataclass(frozen=True)
class AimedRays:
    """What becomes of the rays of one LiDAR that meet the object when it is alone in the world.

    `dark` are those that meet it, too near or too dark to return light; `lost` those whose return
    drop-off or a correction loses, expected, rounded; `stopped` those that something else stops, by
    the id of an object or a value of `NAMES`; the other LiDARs are part of the vehicle."""

    aimed: int
    returned: int
    dark: int
    lost: int
    stopped: dict[str, int]

    @property
    def text(self) -> str:
        """In words."""
        if not self.aimed:
            return "no ray aims at it: it is between the rings, or out of view or range"
        parts = [f"{self.aimed:,} rays aim at it", f"{self.returned:,} return"]
        if self.dark:
            parts.append(f"{self.dark:,} meet it too near or too dark to return")
        if self.lost:
            parts.append(f"about {self.lost:,} are lost by drop-off or the correction")
        parts += [f"{number:,} stopped by {what}" for what, number in self.stopped.items()]
        return ", ".join(parts)


def why_unseen(
    frame: Frame, object_id: str, placement: Placement, vehicle: Vehicle | None = None
) -> tuple[AimedRays, ...]:
    """What becomes of the rays that each LiDAR, on a sedan if `vehicle` is None, aims at an object.
    Raises ValueError: there is no such object in the frame."""
    number = int(frame.row["frame"])
    surroundings = Surroundings(frame.log)
    ids = frame.log.boxes["object_id"].iloc[surroundings.rows(number)].astype(str).tolist()
    if object_id not in ids:
        known, place = ", ".join(ids), f"frame {number}"
        raise InputError("no such object", place=place, expected=known, found=repr(object_id))
    own = ids.index(object_id)
    object_class = surroundings.classes(number)[own]
    names = NAMES | dict(enumerate(ids)) | {PANE - n: known for n, known in enumerate(ids)}
    world = surroundings.world(number)
    parts = body_parts(vehicle).and_(surroundings.parts(number, np.inf))
    mine = (parts.owner == own) | (parts.owner == PANE - own)
    alone = Parts(parts.geometry[mine], parts.owner[mine], parts.reflectivity[mine])
    found, ends_of_each = [], ends_in_rig(placement, vehicle)
    for mount, lidar, ends in zip(placement.mounts, placement.lidars, ends_of_each, strict=True):
        aimed = cast(mount, lidar, alone, level=world is None).target == own
        met = cast_in_world(mount, lidar, parts, world, ends=ends)
        reached = np.flatnonzero(aimed & (met.target == own))
        away, bright = met.range[reached], lidar.sight(met.reflected[reached])
        returned = reached[(away >= lidar.min_range) & (away <= bright)]
        kept = expected_share(lidar, object_class, returned, met.range[returned])
        lost = round(float((1 - kept).sum()))
        others = met.target[aimed & (met.target != own)].tolist()
        stopped = Counter(names.get(target, "the ground") for target in others)
        dark = len(reached) - len(kept)
        rays = int(aimed.sum()), len(kept) - lost, dark, lost, dict(stopped.most_common())
        found.append(AimedRays(*rays))
    return tuple(found)
