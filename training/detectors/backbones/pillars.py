"""Pillars: points grouped by cell of a horizontal grid, encoded by a small PointNet.

PointPillars (Lang et al., CVPR 2019), section 2.1. Upstream pads the points of a pillar to a fixed
number: zero rows go through batch norm and take part in the maximum. Here this is done in closed
form."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from lidarplace.base.kernel_cache import njit
from training.detectors.detector import PointRange
from training.detectors.layers import PaddedBatchNorm
from training.ops.grouping import counting_sort


@dataclass(frozen=True)
class PillarGrid:
    """A horizontal grid over a range."""

    point_range: PointRange  # lowest and highest corner, metres; a whole number of cells in x and y
    size: tuple[float, float]  # edge of a pillar in x and y, metres
    max_points: int | None = None  # points of a pillar beyond this number are dropped
    max_pillars: tuple[int, int] | None = None  # so are pillars, in training and in evaluation

    @property
    def shape(self) -> tuple[int, int]:
        """Number of pillars along x and y."""
        low, high = self.point_range[:3], self.point_range[3:]
        nx, ny = (round((high[i] - low[i]) / self.size[i]) for i in range(2))
        return nx, ny

    def limits(self, training: bool) -> tuple[int, int]:
        """Points of a pillar, and pillars of a frame, beyond which they are dropped."""
        nx, ny = self.shape
        pillars = nx * ny if self.max_pillars is None else self.max_pillars[0 if training else 1]
        return self.max_points or np.iinfo(np.int64).max, pillars

    def cells(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """Number the cell iy * nx + ix of each point (N, 4), -1 outside or not finite, (N,)."""
        low = np.array(self.point_range[:3], np.float32)
        height = self.point_range[5] - self.point_range[2]
        return _cells_kernel(points, low, np.array([*self.size, height], np.float32), *self.shape)

    @cached_property
    def axes(self) -> tuple[NDArray[np.float32], NDArray[np.float32], np.float32]:
        """Centres of the pillars along x, (nx,), and y, (ny,), and their middle height."""
        nx, ny = self.shape
        x, _, z = self.centres(torch.arange(nx)).T.contiguous().numpy()
        y = self.centres(nx * torch.arange(ny))[:, 1].contiguous().numpy()
        return x, y, z[0]

    def centres(self, cells: Tensor) -> Tensor:
        """Centres of the pillars of cells (P,), shape (P, 3), float32."""
        nx, _ = self.shape
        # In float32, as where the points were grouped.
        low, high = np.array(self.point_range, np.float32).reshape(2, 3).tolist()
        x = (cells % nx) * self.size[0] + (self.size[0] / 2 + low[0])
        y = (cells // nx) * self.size[1] + (self.size[1] / 2 + low[1])
        z = torch.full_like(x, (low[2] + high[2]) / 2)
        return torch.stack([x, y, z], dim=1)


@dataclass(frozen=True)
class PillarBatch:
    """Points of a batch of frames that lie in pillars, pillar after pillar."""

    points: Tensor  # x, y, z, intensity, shape (N, 4), float32
    pillar: Tensor  # pillar of each point, not decreasing, shape (N,), int64
    counts: Tensor  # points of each pillar, shape (P,), int64
    cells: Tensor  # frame * ny * nx + iy * nx + ix of each pillar, shape (P,), int64


# Without Python's check for a division by zero the loop becomes vector code.
@njit(cache=True, error_model="numpy")
def _cells_kernel(points, low, size, nx, ny) -> NDArray[np.int32]:
    cells = np.empty(len(points), np.int32)
    for i in range(len(points)):
        # float32 throughout, as upstream: a point on an edge must fall on the same side.
        fx = np.floor((points[i, 0] - low[0]) / size[0])
        fy = np.floor((points[i, 1] - low[1]) / size[1])
        fz = np.floor((points[i, 2] - low[2]) / size[2])
        inside = (fx >= 0) & (fx < nx) & (fy >= 0) & (fy < ny) & (fz == 0)
        inside &= np.abs(points[i, 3]) < np.inf
        cells[i] = np.int32(fy) * nx + np.int32(fx) if inside else -1
    return cells


@njit(cache=True)
def _group_kernel(points, cells, all_cells, max_points, max_pillars):
    """Points pillar after pillar, cells in order of appearance, points per pillar."""
    table = np.full(all_cells, -1, np.int64)
    pillar = np.full(len(points), -1, np.int64)
    pillar_cells = np.empty(min(len(points), all_cells), np.int64)
    counts = np.zeros(len(pillar_cells), np.int64)
    pillars = 0
    for i in range(len(points)):
        if cells[i] < 0:
            continue
        p = table[cells[i]]
        if p < 0:
            if pillars == max_pillars:
                continue
            p = table[cells[i]] = pillars
            pillar_cells[p] = cells[i]
            pillars += 1
        if counts[p] < max_points:
            counts[p] += 1
            pillar[i] = p
    rows = np.flatnonzero(pillar >= 0)
    order, _ = counting_sort(pillar[rows], pillars)
    return points[rows[order]], pillar_cells[:pillars], counts[:pillars]


def group(
    frames: Sequence[Tensor], grid: PillarGrid, training: bool, device: torch.device
) -> PillarBatch:
    """Group the points (N, 4) of each frame into pillars; points outside the range are dropped."""
    if device.type != "cpu":
        from training.ops.gpu.grouping import points_by_cell

        (nx, ny), height = grid.shape, grid.point_range[5] - grid.point_range[2]
        low, edges = np.array([grid.point_range[:3], (*grid.size, height)], np.float32).tolist()
        limits = grid.limits(training)
        return PillarBatch(*points_by_cell(frames, device, (low, edges), (1, ny, nx), limits))
    every = math.prod(grid.shape)
    parts = []
    for i, frame in enumerate(frames):
        array = frame.detach().cpu().numpy().astype(np.float32, copy=False)
        points, cells, counts = _group_kernel(
            array, grid.cells(array), every, *grid.limits(training)
        )
        parts.append((points, cells + i * every, counts))
    points, cells, counts = (
        torch.from_numpy(np.concatenate(part)) for part in zip(*parts, strict=True)
    )
    return PillarBatch(points, torch.repeat_interleave(counts), counts, cells)


class PillarFeatureLayer(nn.Module):
    """Linear layer, batch norm, ReLU and the maximum over each pillar."""

    def __init__(self, inputs: int, outputs: int, momentum: float) -> None:
        super().__init__()
        self.linear = nn.Linear(inputs, outputs, bias=False)
        self.norm = PaddedBatchNorm(outputs, eps=1e-3, momentum=momentum)

    def forward(self, features: Tensor, batch: PillarBatch, max_points: int | None) -> Tensor:
        """Features (N, inputs) of the points to features (P, outputs) of the pillars."""
        # Coordinates are among them, and 16 bits would round them to 25 cm at the far end.
        with torch.autocast(features.device.type, enabled=False):
            rows = self.linear(features)
        if max_points is None:
            return _pillar_max(functional.relu(self.norm(rows)), batch.counts)
        padding = len(batch.counts) * max_points - len(rows)
        # One more row, of zeros, stands for all of the padding.
        rows = torch.cat([rows, rows.new_zeros(1, rows.shape[1])])
        normal = functional.relu(self.norm(rows, padding - 1))
        largest = _pillar_max(normal[:-1], batch.counts)
        full = (batch.counts == max_points)[:, None]
        return torch.where(full, largest, torch.maximum(largest, normal[-1]))


def _pillar_max(rows: Tensor, counts: Tensor) -> Tensor:
    """Maximum over runs of `counts` rows, (N, C) to (P, C); rows are not negative."""
    return torch.segment_reduce(rows, "max", lengths=counts, axis=0, initial=0.0, unsafe=True)


class PillarEncoder(nn.Module):
    """Encoder of the points of each pillar as one feature vector.

    A point's features are x, y, z, intensity, its offset from the mean of the pillar's points and
    from the pillar's centre."""

    def __init__(self, grid: PillarGrid, filters: int, momentum: float) -> None:
        super().__init__()
        self.grid = grid
        self.filters = filters
        self.pfn_layers = nn.ModuleList([PillarFeatureLayer(10, filters, momentum)])

    def forward(self, batch: PillarBatch) -> Tensor:
        """Features of the pillars, shape (P, filters)."""
        if len(batch.counts) == 0:  # segment_reduce takes no empty input
            return batch.points.new_zeros(0, self.filters)
        xyz = batch.points[:, :3]
        # In the order of the points: sums by atomic additions would differ from run to run.
        sums = torch.segment_reduce(xyz, "sum", lengths=batch.counts, axis=0, unsafe=True)
        means = sums / batch.counts[:, None]
        centres = self.grid.centres(batch.cells % math.prod(self.grid.shape))
        offsets = [xyz - origin[batch.pillar] for origin in (means, centres)]
        features: Tensor = torch.cat([batch.points, *offsets], dim=1)
        for layer in self.pfn_layers:
            features = layer(features, batch, self.grid.max_points)
        return features


def scatter(features: Tensor, cells: Tensor, frames: int, grid: PillarGrid) -> Tensor:
    """Place pillar features (P, C) in an image (frames, C, ny, nx), zero without a pillar."""
    nx, ny = grid.shape
    image = features.new_zeros(frames * ny * nx, features.shape[1])
    image.index_copy_(0, cells, features)
    # Channels last in memory, which convolutions on a CPU like better.
    return image.view(frames, ny, nx, -1).permute(0, 3, 1, 2)
