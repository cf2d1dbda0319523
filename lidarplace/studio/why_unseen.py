"""Why is an object not seen, or hardly: what becomes of the rays that aim at it."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.raycast import cast, expected_share
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.clouds.shapes import BODY, BUILDING, PANE, SIGN, WORLD, Parts
from lidarplace.clouds.static_world import WorldAround, cast_in_world
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.viewing.frame import Frame


@dataclass(frozen=True)
class AimedRays:
    """What becomes of the rays of one LiDAR that meet the object when it is alone in the world.

    Attributes:
        aimed: number of these rays.
        returned: those whose light comes back from it.
        dark: those that meet it, too near or too dark to return light.
        lost: those whose return drop-off or a correction loses; expected, rounded.
        stopped: those that something else stops, by what it is: the id of an object, "a building"
            or "the vehicle itself", which its other LiDARs belong to.
    """

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
    """What becomes of the rays that each LiDAR aims at an object of the frame.

    Args:
        vehicle: carries the LiDARs; None: a sedan.

    Raises:
        ValueError: there is no such object in the frame.
    """
    number = int(frame.row["frame"])
    surroundings = Surroundings(frame.log)
    ids = frame.log.boxes["object_id"].iloc[surroundings.rows(number)].astype(str).tolist()
    if object_id not in ids:
        raise ValueError(f"no object {object_id!r} in frame {number}; there are {', '.join(ids)}")
    own = ids.index(object_id)
    world = surroundings.world(number)
    everything = body_parts(vehicle).and_(surroundings.parts(number, np.inf))
    ends = ends_in_rig(placement, vehicle)
    object_class = surroundings.classes(number)[own]
    lidars = zip(placement.mounts, placement.lidars, ends, strict=True)
    return tuple(
        _aimed(mount, lidar, everything, world, own, object_class, ids, met)
        for mount, lidar, met in lidars
    )


def _aimed(
    mount: Mount,
    lidar: Lidar,
    parts: Parts,
    world: WorldAround | None,
    own: int,
    object_class: str,
    ids: list[str],
    ends: NDArray[np.float64],
) -> AimedRays:
    mine = (parts.owner == own) | (parts.owner == PANE - own)
    alone = Parts(parts.geometry[mine], parts.owner[mine], parts.reflectivity[mine])
    aimed = cast(mount, lidar, alone, level=world is None).target == own
    met = cast_in_world(mount, lidar, parts, world, ends=ends)
    names = {
        BODY: "the vehicle itself",
        BUILDING: "a building",
        SIGN: "a sign",
        WORLD: "what stands still and has no label",
    }
    names |= dict(enumerate(ids))
    names |= {PANE - number: object_id for number, object_id in enumerate(ids)}
    targets = Counter(met.target[aimed].tolist())
    reached = aimed & (met.target == own)
    bright = lidar.sight(met.reflected[reached])
    returned = (met.range[reached] >= lidar.min_range) & (met.range[reached] <= bright)
    stopped = Counter[str]()
    for target, rays in targets.items():
        if target != own:
            stopped[names.get(target, "the ground")] += rays
    bright_enough = np.flatnonzero(reached)[returned]
    kept = expected_share(lidar, object_class, bright_enough, met.range[bright_enough])
    lost = round(float((1 - kept).sum()))
    return AimedRays(
        int(aimed.sum()),
        len(kept) - lost,
        int(reached.sum()) - len(kept),
        lost,
        dict(stopped.most_common()),
    )
