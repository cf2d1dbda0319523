"""Clouds cast on a GPU: all LiDARs of all frames of a batch in one launch.

Parts, windows and planes are prepared on the CPU, for all frames in one call, and the points stay
on the device. They are those of the CPU, but for rays within rounding of an edge: exponentials and
logarithms differ in the last bit. LiDARs that take time for a frame are cast on the CPU, and so are
static worlds: a ray follows their columns, the blocks of a column and the cells of a block. The
lanes of a Triton program share their loops, so each of these three would last as long as its
slowest ray, and the kernel would be a second source of `lidarplace.clouds.static_world`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.clouds.clouds import CloudFrames, JoinedClouds, grid_step
from lidarplace.clouds.collect import Scene, SimulatedClouds
from lidarplace.clouds.droplets import drop_reflectivity, sight_of_drops
from lidarplace.clouds.ground import CELL_M
from lidarplace.clouds.raycast import Beams, Surfaces, beams_of
from lidarplace.clouds.returns import ATTENUATION_PER_M
from lidarplace.clouds.seen_parts import SEEN_COLUMNS, Views, fill_seen
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement, blocks

Table = NDArray[np.float64]


def points_on(device: torch.device, clouds: CloudFrames, batch: range) -> list[Tensor]:
    """Return the points of frames of clouds on a device, (n, 4) float32 each, the caller's own.

    On a GPU simulated clouds are cast there; others are copied at once."""
    if device.type == "cpu":
        return _copied(clouds, batch, device)
    points: list[Tensor] = []
    for part, frames in groupby(map(partial(_part_of, clouds), batch), key=itemgetter(0)):
        indices = [index for _, index in frames]
        castable = isinstance(part, SimulatedClouds) and not part.needs_cpu()
        points += (cast_frames if castable else _copied)(part, indices, device)
    return points


def _part_of(clouds: CloudFrames, index: int) -> tuple[CloudFrames, int]:
    """Return the clouds that a frame is of, and its index in them."""
    return clouds.part(index) if isinstance(clouds, JoinedClouds) else (clouds, index)


def _copied(clouds: CloudFrames, batch: Sequence[int], device: torch.device) -> list[Tensor]:
    arrays = [clouds[index] for index in batch]
    points = torch.from_numpy(np.concatenate(arrays)).to(device)
    return list(points.split([len(array) for array in arrays]))


def cast_frames(
    clouds: SimulatedClouds, batch: Sequence[int], device: torch.device
) -> list[Tensor]:
    """Cast frames of simulated clouds without a static world by kernels on a device.

    Returns the points of each frame, those of `clouds[index]`, (n, 4) float32."""
    from training.ops.gpu.casting import cast_rays, programs_of

    scenes = clouds.scenes(batch)
    tables = _Tables()
    rigs = [tables.rig(scene, clouds) for scene in scenes]
    numbers = np.concatenate([rig.numbers for rig in rigs])
    integers = np.concatenate([rig.integers for rig in rigs])
    views = [len(rig.numbers) for rig in rigs]
    _place(numbers, scenes, views)
    seen = _see(clouds, batch, scenes, rigs, integers)
    _add_factors(tables, scenes, rigs, integers)
    rays = integers[:, _RAYS].copy()
    programs, first = programs_of(torch.from_numpy(rays))
    integers[:, 0], integers[:, _FIRST_POINT] = first.numpy(), rays.cumsum() - rays
    ground = np.ascontiguousarray(scenes[0].ground.reflectivity)
    arrays = (numbers, integers, *tables.arrays(seen), ground.copy())
    on_device = [torch.from_numpy(np.ascontiguousarray(a)).to(device) for a in arrays]
    points, returned = cast_rays(
        programs.to(device), (on_device[0], on_device[1]), tuple(on_device[2:]), int(rays.sum())
    )
    last = torch.from_numpy(rays.cumsum()[np.cumsum(views) - 1] - 1)
    ends = returned.cumsum(0)[last.to(device)].tolist()  # how many return cannot be known
    return list(points[returned].split(np.diff([0, *ends]).tolist()))


_RAYS, _FIRST_SEEN, _FACTORS, _STREAM, _FIRST_POINT = 1, 6, 10, 12, 15
"""Columns of `training.ops.gpu.casting.INTEGERS` that depend on the batch."""
_POSE = 27
"""First of the columns of its NUMBERS that are of the frame."""


@dataclass(frozen=True)
class _Rig:
    """Views of a rig: rows of both tables of the kernel, and what `Views` has of them."""

    numbers: Table
    integers: NDArray[np.int64]
    reach: Table
    regions: Table
    elevations: Table
    lidars: NDArray[np.int64]
    corrections: list[Lidar]


class _BeamRows(NamedTuple):
    """First rows of the angles and the mask of a LiDAR, and its lowest and highest elevation."""

    elevations: int
    azimuths: int
    mask: int
    limits: tuple[float, float]


@dataclass
class _Tables:
    """Tables of the kernel that several views share, and the rigs that use them."""

    _elevations: list[Table] = field(default_factory=list)
    _azimuths: list[Table] = field(default_factory=list)
    _ends: list[Table] = field(default_factory=lambda: [np.zeros(1)])
    _masks: list[Table] = field(default_factory=lambda: [np.ones(1)])
    factors: list[Table] = field(default_factory=lambda: [np.ones(1)])
    _beams: dict[Lidar, _BeamRows] = field(default_factory=dict)
    _rig: tuple[Placement, _Rig] | None = None

    def rig(self, scene: Scene, clouds: SimulatedClouds) -> _Rig:
        """Return the views of the rig of a frame, which mostly is that of the frame before."""
        if self._rig is None or self._rig[0] is not scene.rig:
            self._rig = scene.rig, self._added(scene, clouds)
        return self._rig[1]

    def arrays(self, seen: Table) -> tuple[Table, ...]:
        """Return the tables in the kernel's order."""
        beams = np.concatenate(self._elevations), np.concatenate(self._azimuths)
        others = map(np.concatenate, (self._ends, self._masks, self.factors))
        return (*beams, seen, *others)

    def _added(self, scene: Scene, clouds: SimulatedClouds) -> _Rig:
        numbers, integers, reach, regions, elevations, owners = [], [], [], [], [], []
        mounted = zip(scene.rig.mounts, scene.rig.lidars, clouds.lifts, scene.ends, strict=True)
        for m, (mount, lidar, lift, ends) in enumerate(mounted):
            first_end = _append(self._ends, ends)
            for block_mount, block, of_block in blocks(mount, lidar):
                beams = beams_of(block)
                numbers.append(_numbers(block_mount, block, beams, lift, clouds))
                is_pattern = int(block.pattern is not None)
                rows = self._rows(block, beams)
                first = -1 if first_end < 0 else first_end + of_block.start
                steps = beams.azimuths.shape[2]
                angles = is_pattern, rows.elevations, rows.azimuths
                shape = (0, block.rays, steps, *angles, 0, 0, first, rows.mask)
                integers.append((*shape, 0, 0, 0, of_block.start, lidar.rays, 0))
                reach.append(beams.reach)
                regions.append(clouds.regions[m])
                elevations.append(rows.limits)
                owners.append(m)
        lists = (np.array(numbers), np.array(integers, np.int64), np.array(reach))
        views = np.array(regions), np.array(elevations), np.array(owners, np.int64)
        return _Rig(*lists, *views, [scene.rig.lidars[m] for m in owners])

    def _rows(self, lidar: Lidar, beams: Beams) -> _BeamRows:
        """Return the rows of a LiDAR, appended if it is new."""
        if lidar not in self._beams:
            angles = np.atleast_2d(lidar.azimuths()).reshape(-1)
            directions = beams.azimuths.transpose(0, 2, 1).reshape(-1, 2)
            azimuths = np.column_stack([angles, directions])
            first = _append(self._elevations, beams.elevations), _append(self._azimuths, azimuths)
            limits = beams.elevations[:, 0].min(), beams.elevations[:, 0].max()
            self._beams[lidar] = _BeamRows(*first, _append(self._masks, beams.mask), limits)
        return self._beams[lidar]


def _append(table: list[Table], rows: Table) -> int:
    """Append rows to a table; return the first, or -1 if there are none."""
    if not len(rows):
        return -1
    table.append(rows)
    return sum(map(len, table)) - len(rows)


def _numbers(
    mount: Mount, lidar: Lidar, beams: Beams, lift: float, clouds: SimulatedClouds
) -> list[float]:
    """Return the numbers of a view, without those of the frame."""
    drops = [0.0, 0.0, 0.0]
    if lidar.extinction > 0.0:
        drops = [lidar.extinction, sight_of_drops(lidar), drop_reflectivity(lidar.extinction)]
    return [
        *(mount.x, mount.y, mount.z),
        *mount.rotation.ravel().tolist(),
        mount.z if mount.z > 0.0 else math.nan,
        1.0 / beams.reach * (1.0 - 4e-16),
        *(beams.nearest, beams.sight_10, beams.falloff, beams.fading, beams.loss),
        *(lift, lidar.range_noise, lidar.drop_off),
        *(ATTENUATION_PER_M + 2.0 * lidar.extinction, lidar.window**2),
        *drops,
        *(0.0, 0.0, 0.0, 0.0),
        *clouds.crop,
        grid_step(clouds.crop),
    ]


def _place(numbers: Table, scenes: Sequence[Scene], views: Sequence[int]) -> None:
    """Fill the place of each frame in the cells of the ground."""
    x, y, yaw = np.array([scene.ground.pose for scene in scenes]).T
    turns = [(math.cos(angle) / CELL_M, math.sin(angle) / CELL_M) for angle in yaw.tolist()]
    poses = np.column_stack([x / CELL_M, y / CELL_M, np.array(turns)])
    numbers[:, _POSE : _POSE + 4] = np.repeat(poses, views, axis=0)


def _see(
    clouds: SimulatedClouds,
    batch: Sequence[int],
    scenes: Sequence[Scene],
    rigs: Sequence[_Rig],
    integers: NDArray[np.int64],
) -> Table:
    """Return the parts that the views see, with their rows and streams filled into `integers`."""
    number = [len(scene.parts) for scene in scenes]
    last = np.cumsum(number)
    views = [len(rig.reach) for rig in rigs]
    lidars = [(index, m) for index, rig in zip(batch, rigs, strict=True) for m in rig.lidars]
    seed, frames = clouds.seed % 2**64, clouds.frames.view(np.uint64).tolist()
    numbers = np.concatenate([rig.numbers for rig in rigs])
    arguments = Views(
        origins=numbers[:, :3].copy(),
        rotations=numbers[:, 3:12].reshape(-1, 3, 3).copy(),
        reach=np.concatenate([rig.reach for rig in rigs]),
        regions=np.concatenate([rig.regions for rig in rigs]),
        elevations=np.concatenate([rig.elevations for rig in rigs]),
        keys=np.array([(seed, frames[index], m) for index, m in lidars], np.uint64),
        parts=np.repeat(np.column_stack([last - number, last]), views, axis=0),
    )
    surfaces = Surfaces(
        np.concatenate([scene.parts.geometry for scene in scenes]),
        np.concatenate([scene.parts.owner for scene in scenes]),
        np.concatenate([scene.parts.reflectivity for scene in scenes]),
    )
    seen = np.empty((max(1, int(np.dot(number, views))), SEEN_COLUMNS))
    rows, streams = np.empty((len(lidars), 2), np.int64), np.empty(len(lidars), np.uint64)
    count = fill_seen(arguments, surfaces, seen, rows, streams)
    integers[:, _FIRST_SEEN : _FIRST_SEEN + 2] = rows
    integers[:, _STREAM] = streams.view(np.int64)
    return seen[: max(1, count)]


def _add_factors(
    tables: _Tables, scenes: Sequence[Scene], rigs: Sequence[_Rig], integers: NDArray[np.int64]
) -> None:
    """Add the factors of corrections by object, and fill where those of each view are."""
    view = 0
    for scene, rig in zip(scenes, rigs, strict=True):
        for lidar in rig.corrections:
            if lidar.correction is not None:
                factors = lidar.correction.factors_of(scene.classes)
                first = _append(tables.factors, factors)
                integers[view, _FACTORS : _FACTORS + 2] = max(first, 0), len(factors)
            view += 1
