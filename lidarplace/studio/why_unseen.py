"""Reasons why an object is not seen, or hardly: the fate of the rays that aim at it."""

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
    BODY: "the rig itself or what carries it",
    BUILDING: "a building",
    SIGN: "a sign",
    WORLD: "what stands still and has no label",
}
"""Names of what stops rays, besides objects and the ground."""


@dataclass(frozen=True)
class AimedRays:
    """Rays of one LiDAR that meet the object when it is alone in the world.

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
        """Description in words."""
        if not self.aimed:
            return "no ray aims at it: it is between the rings, or out of view or range"
        parts = [f"{self.aimed:,} rays aim at it", f"{self.returned:,} return"]
        if self.dark:
            parts.append(f"{self.dark:,} meet it too near or too dark to return")
        if self.lost:
            parts.append(f"about {self.lost:,} are lost by drop-off or the correction")
        parts += [f"{number:,} stopped by {obstacle}" for obstacle, number in self.stopped.items()]
        return ", ".join(parts)


def why_unseen(
    frame: Frame, object_id: str, placement: Placement, vehicle: Vehicle | None = None
) -> tuple[AimedRays, ...]:
    """Return the fate of the rays that each LiDAR aims at an object; on a sedan without `vehicle`.

    Raises ValueError: there is no such object in the frame."""
    number = int(frame.row["frame"])
    surroundings = Surroundings(frame.log)
    ids = frame.log.boxes["object_id"].iloc[surroundings.rows(number)].astype(str).tolist()
    if object_id not in ids:
        expected, place = ", ".join(ids), f"frame {number}"
        raise InputError("no such object", place=place, expected=expected, found=repr(object_id))
    owner = ids.index(object_id)
    object_class = surroundings.classes(number)[owner]
    names = NAMES | dict(enumerate(ids)) | {PANE - n: name for n, name in enumerate(ids)}
    world = surroundings.world(number)
    parts = body_parts(vehicle).and_(surroundings.parts(number, np.inf))
    mine = (parts.owner == owner) | (parts.owner == PANE - owner)
    alone = Parts(parts.geometry[mine], parts.owner[mine], parts.reflectivity[mine])
    aimed_rays, ends_of_each = [], ends_in_rig(placement, vehicle)
    for mount, lidar, ends in zip(placement.mounts, placement.lidars, ends_of_each, strict=True):
        aimed = cast(mount, lidar, alone, level=world is None).target == owner
        met = cast_in_world(mount, lidar, parts, world, ends=ends)
        reached = np.flatnonzero(aimed & (met.target == owner))
        away, bright = met.range[reached], lidar.sight(met.reflected[reached])
        returned = reached[(away >= lidar.min_range) & (away <= bright)]
        shares = expected_share(lidar, object_class, returned, met.range[returned])
        lost = round(float((1 - shares).sum()))
        others = met.target[aimed & (met.target != owner)].tolist()
        stopped = Counter(names.get(target, "the ground") for target in others)
        dark = len(reached) - len(shares)
        rays = int(aimed.sum()), len(shares) - lost, dark, lost, dict(stopped.most_common())
        aimed_rays.append(AimedRays(*rays))
    return tuple(aimed_rays)
