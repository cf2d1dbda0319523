"""Point clouds of a placement: all its LiDARs in every frame of a box log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Interval
from lidarplace.clouds.clouds import Crop, PointClouds, as_kept
from lidarplace.clouds.droplets import scatter_back
from lidarplace.clouds.ground import Ground
from lidarplace.clouds.hashed import key_of
from lidarplace.clouds.moving import Motion, Scan, cast_moving, poses_at
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.raycast import Hits
from lidarplace.clouds.returns import LARGEST_ERROR, CloudPart, sample_points
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.clouds.shapes import Parts
from lidarplace.clouds.static_world import cast_in_world
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.worlds import WorldAround
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.errors import MountingErrors
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.scan_timing import ScanTiming

FASTEST_M_S = 100.0
"""Speed of a vehicle at most: buildings that it may reach within a frame matter."""
_PHASE = 1  # purpose of a random number
GROUND_MARGIN_M = 0.5
"""Points this far below the ROI are kept: a noisy return from the ground lies under z = 0."""


def crop_for(
    x: Interval, y: Interval, z: Interval, placement: Placement, misaligned_heights: bool = False
) -> Crop:
    """Return the region of a cloud that holds the ROI x, y, z and the ground under it.

    It is deeper where clouds are merged without regard to heights, as the ground of a LiDAR higher
    than the first one sinks."""
    heights = [mount.z for mount in placement.mounts]
    sinks = max(heights) - heights[0] if misaligned_heights else 0.0
    return x[0], y[0], z[0] - GROUND_MARGIN_M - sinks, x[1], y[1], z[1]


def collect(
    log: BoxLog,
    frames: ArrayLike,
    placement: Placement,
    crop: Crop,
    seed: int = 0,
    misaligned_heights: bool = False,
    errors: MountingErrors = MountingErrors(),
    vehicle: Vehicle | None = None,
) -> PointClouds:
    """Simulate the merged clouds of all LiDARs of `placement` in the given frames.

    Every placement sees the same objects and buildings. Drop-off and range noise of a ray depend on
    seed, frame number, LiDAR and ray only, so frames may be collected in any portions. So does what
    a LiDAR with a pattern fires of it: real ones are not in step.

    Args:
        log: a box log; its other frames are ignored.
        frames: frame numbers, shape (F,); a frame without a box shows ground, buildings and world.
        placement: mounts and LiDAR, at most 256.
        crop: x0, y0, z0, x1, y1, z1 in the ego frame, metres; points outside are left out.
        seed: of shapes and materials, drop-off and range noise.
        misaligned_heights: merge the clouds as if every LiDAR were as high as the first: those of
            higher ones sink, those of lower ones rise. They are cut after that.
        errors: of the mounts, drawn anew for every frame: a fleet, whose vehicles differ.
        vehicle: carries the LiDARs; None: a sedan.

    Raises:
        ValueError: a box is bad, a frame is not in the log, the crop is empty, or a LiDAR takes
            time for a frame, and the log does not show motion or has a static world."""
    settings = seed, misaligned_heights, errors, vehicle
    return SimulatedClouds(log, frames, placement, crop, *settings).kept()


class Scene(NamedTuple):
    """Rig and surroundings of one frame, before any ray is cast.

    Attributes:
        rig: with mounting errors, and with the part of its patterns that is fired.
        ends: of the rays of each LiDAR at the rig, see `lidarplace.clouds.shade`.
        parts: objects, buildings and the vehicle's own body.
        world: static world; None where the log has none.
        classes: of the objects, for a correction; empty without one.
        motion: of the parts, for LiDARs that take time for a frame; None where none does."""

    rig: Placement
    ends: list[NDArray[np.float64]]
    parts: Parts
    ground: Ground
    world: WorldAround | None
    classes: list[str]
    motion: Motion | None


class SimulatedClouds:
    """The clouds of `collect`, each simulated when it is indexed, and not kept.

    `clouds[i]` has the points of `collect(…)[i]`, to the last bit, without packing them. Arguments
    and errors as of `collect`; an error about a frame comes when it is indexed. In the place of a
    log, clouds of several rigs can share its `Surroundings` of the same seed.

    Attributes:
        frames: frame numbers, shape (F,), int64.
        crop, seed: as of `collect`.
        lifts: height by which the points of each LiDAR are raised before the cut, metres.
        regions: from which points of each LiDAR may err into the crop, without its lift."""

    def __init__(
        self,
        log: BoxLog | Surroundings,
        frames: ArrayLike,
        placement: Placement,
        crop: Crop,
        seed: int = 0,
        misaligned_heights: bool = False,
        errors: MountingErrors = MountingErrors(),
        vehicle: Vehicle | None = None,
    ) -> None:
        if not all(low < high for low, high in zip(crop[:3], crop[3:], strict=True)):
            raise InputError(key="crop", expected="x0 < x1, y0 < y1, z0 < z1", found=crop)
        lidars, mounts = placement.lidars, placement.mounts
        if len(mounts) > 256:
            raise InputError(key="mounts", expected="at most 256 in a cloud", found=len(mounts))
        self.frames = np.asarray(frames, np.int64)
        self._surroundings = Surroundings(log, seed) if isinstance(log, BoxLog) else log
        if self._surroundings.seed != seed:
            raise InputError(key="seed", expected=self._surroundings.seed, found=seed)
        self._placement, self._errors = placement, errors
        self._vehicle, self._body = vehicle, body_parts(vehicle)
        self._patterns = any(lidar.pattern is not None for lidar in lidars)
        self._take_time = any(lidar.timing is not None for lidar in lidars)
        moves = bool(errors) or self._patterns
        self._ends = None if moves else ends_in_rig(placement, vehicle)
        self.crop, self.seed = crop, seed
        self.lifts = [mounts[0].z - mount.z if misaligned_heights else 0.0 for mount in mounts]
        # A point may err into the crop from outside, so what is cast is a little larger.
        slack = LARGEST_ERROR * max(lidar.range_noise for lidar in lidars)
        low, high = np.array(crop[:3]) - slack, np.array(crop[3:]) + slack
        self.regions = [(*(low - [0, 0, z]), *(high - [0, 0, z])) for z in self.lifts]
        # A building matters if it can stand before a point of the crop: as seen from above, neither
        # farther than the crop's farthest corner nor than the sensor itself.
        corners = np.maximum(np.abs(low), np.abs(high))
        away = max(math.hypot(mount.x, mount.y) for mount in mounts) + math.sqrt(2) * errors.offset
        longest = max(lidar.range for lidar in lidars)
        self._reach = min(max(math.hypot(*corners[:2]), away), longest + slack + away)
        half = max((lidar.timing.half for lidar in lidars if lidar.timing), default=0.0)
        self._reach += half * FASTEST_M_S
        self._points = np.empty((sum(lidar.rays for lidar in lidars), 4), np.float32)
        self._hits: dict[int, Hits] = {}

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> NDArray[np.float32]:
        """Return the points of the `index`-th frame, shape (n, 4), float32, the caller's own."""
        return as_kept(self.returns(index)[0], self.crop)

    def scene(self, index: int) -> Scene:
        """Return rig and surroundings of a frame."""
        return self.scenes([index])[0]

    def scenes(self, indices: Sequence[int]) -> list[Scene]:
        """Return rig and surroundings of several frames, faster than one by one."""
        frames = self.frames[list(indices)].tolist()
        parts = self._surroundings.shared_parts(frames, self._reach)
        return [self._scene(*of_frame) for of_frame in zip(frames, parts, strict=True)]

    def _scene(self, frame: int, surrounding: Parts) -> Scene:
        parts = self._body.and_(surrounding)
        ground, world = self._surroundings.ground(frame), self._surroundings.world(frame)
        rig = self._placement
        if self._errors:
            rig = self._errors.drawn(rig, self.seed, frame)
        if self._patterns:
            rig = _in_frame(rig, self.seed, frame)
        ends = ends_in_rig(rig, self._vehicle) if self._ends is None else self._ends
        corrected = any(lidar.correction for lidar in rig.lidars)
        classes = self._surroundings.classes(frame) if corrected else []
        motion = self._surroundings.motion(frame, parts) if self._take_time else None
        return Scene(rig, ends, parts, ground, world, classes, motion)

    def has_static_world(self) -> bool:
        """Test if any scene of the log has a static world."""
        return bool(self._surroundings.worlds.origins.size)

    def needs_cpu(self) -> bool:
        """Test if the clouds have a part that is cast on the CPU alone: time, or a world."""
        return self._take_time or self.has_static_world()

    def kept(self) -> PointClouds:
        """Simulate all frames and pack them."""
        clouds = (self.returns(index) for index in range(len(self)))
        return PointClouds.from_frames(self.frames, clouds, self.crop)

    def returns(self, index: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return the points of a frame before rounding, and the number from each LiDAR.

        The next call uses the memory again."""
        frame, scene = int(self.frames[index]), self.scene(index)
        rig, ground = scene.rig, scene.ground
        counts = np.zeros(len(rig.mounts), np.int32)
        views = zip(rig.mounts, rig.lidars, self.lifts, strict=True)
        for m, (mount, lidar, lift) in enumerate(views):
            free, key = self._points[counts.sum() :], (self.seed, frame, m)
            hits, poses = self._cast(scene, m, key)
            scatter_back(lidar, hits, key)
            part = CloudPart(key, lift, scene.classes, poses)
            counts[m] = sample_points(mount, lidar, hits, ground, self.crop, part, free)
        return self._points[: counts.sum()], counts

    def _cast(
        self, scene: Scene, number: int, key: tuple[int, int, int]
    ) -> tuple[Hits, NDArray[np.float64] | None]:
        """Return the hits of a LiDAR, and the poses of the vehicle that move its points, if any.

        Hits of LiDARs with as many rays share memory."""
        mount, lidar = scene.rig.mounts[number], scene.rig.lidars[number]
        region, ends, into = self.regions[number], scene.ends[number], self._hits.get(lidar.rays)
        if scene.motion is None or (timing := lidar.timing) is None:
            surroundings, poses = (scene.parts, scene.world, region), None
            hits = cast_in_world(mount, lidar, *surroundings, into, ends)
        else:
            ego, phase = scene.motion.ego, timing.phase
            if phase is None:
                phase = np.random.default_rng(key_of(*key, _PHASE)).uniform(0, 2 * math.pi)
            scan, poses = _scan(lidar, timing, phase, tuple(ego.tolist()))
            if poses is not None:
                region = _grown(region, timing.half, ego)
            moving = scene.parts, scene.motion, scan
            hits = cast_moving(mount, lidar, *moving, region, into, ends)
        self._hits[lidar.rays] = hits
        return hits, poses


@lru_cache(maxsize=8)  # equal LiDARs of a rig share it
def _scan(
    lidar: Lidar, timing: ScanTiming, phase: float, ego: tuple[float, ...]
) -> tuple[Scan, NDArray[np.float64] | None]:
    """Return the moments of the rays of a LiDAR, and poses of the vehicle that move its points."""
    scan = _moments(lidar, timing, phase)
    return scan, poses_at(scan.moments, ego) if timing.compensated else None


@lru_cache(maxsize=64)
def _moments(lidar: Lidar, timing: ScanTiming, phase: float) -> Scan:
    return Scan.at(timing.moments(lidar.scan_shares(), phase))


def _grown(region: Crop, half: float, ego: NDArray[np.float64]) -> Crop:
    """Return a region that holds another one as the vehicle sees it within `half` a frame."""
    x0, y0, z0, x1, y1, z1 = region
    farthest = math.hypot(max(abs(x0), abs(x1)), max(abs(y0), abs(y1)))
    slack = half * (math.hypot(ego[0], ego[1]) + abs(float(ego[2])) * farthest)
    return x0 - slack, y0 - slack, z0, x1 + slack, y1 + slack, z1


def _in_frame(placement: Placement, seed: int, frame: int) -> Placement:
    """Return the rig with the part of its patterns that each LiDAR fires in a frame."""
    draws = (np.random.default_rng(key_of(seed, frame, n)) for n in range(len(placement.mounts)))
    lidars = zip(placement.lidars, draws, strict=True)
    return placement.with_lidar(
        [lidar.in_frame(int(draw.integers(2**32))) for lidar, draw in lidars]
    )
