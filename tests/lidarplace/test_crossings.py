import numpy as np
import pytest

from lidarplace import PAPER_PLACEMENTS, Lidar, OccupancyGrid, Roi, evaluate
from lidarplace.coverage.rays import log_miss, ray_counts, ray_weight
from lidarplace.pog.surrogates import formulas
from lidarplace.pog.surrogates.formulas import (
    Crossings,
    expected_ig,
    expected_ig_with_occlusion,
    expected_points,
    log_miss_of_ray,
)

TALL = Roi(x=(0.0, 2.0), y=(0.0, 3.0), z=(0.0, 35.0), resolution=0.5)  # 70 layers: two words
FRAMES = 50


def grid_of(counts, roi):
    return OccupancyGrid(roi, "Car", counts.astype(np.int32), FRAMES)


@pytest.mark.parametrize("table", [0, 2**20])
def test_pairs_of_counts_and_rays(table, monkeypatch):
    monkeypatch.setattr(formulas, "_TABLE", table)
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 5, TALL.shape)
    counts[:, :, 66:] = 0
    rays = rng.integers(0, 4, TALL.shape) * rng.integers(1, 100, TALL.shape)
    rays = rays.astype(np.int32)
    expected = {}
    for pair in zip(counts.flat, rays.flat, strict=True):
        if min(pair) > 0:
            expected[pair] = expected.get(pair, 0) + 1
    for layers in (70, 66):
        found = Crossings.of_grid(grid_of(counts, TALL), rays[..., :layers])
        pairs = zip(found.counts.tolist(), found.rays.tolist(), strict=True)
        assert dict(zip(pairs, found.voxels.tolist(), strict=True)) == expected


@pytest.mark.parametrize("method", ["cone", "dda", "bresenham"])
@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize("layers", [1, 7, 20])
def test_empty_layers_above_the_occupied_ones_change_nothing(method, stride, layers):
    roi = Roi(x=(-1.0, 5.0), y=(-3.0, 3.0), z=(0.0, 4.0), resolution=0.2)
    counts = np.random.default_rng(1).integers(0, FRAMES, roi.shape)
    counts[:, :, layers:] = 0
    grid = grid_of(counts, roi)
    lidar = Lidar(tuple(np.radians(np.linspace(-80, 20, 9))), azimuth_steps=300)
    rays_by = "bresenham" if method == "bresenham" else "dda"
    for name in ("line_roll", "center", "pyramid_pitch"):
        rig = PAPER_PLACEMENTS[name].with_lidar(lidar)
        options = {"azimuth_stride": stride, "method": method}
        names = ["expected_points", "expected_ig"]
        found = evaluate(grid, rig, surrogates=names, **options)
        weight = ray_weight(rig, stride)
        whole = Crossings.of_grid(grid, ray_counts(rig, roi, rays_by, stride))
        assert found.expected_points == expected_points(grid.frames, whole, weight)
        miss = weight * log_miss_of_ray(0.1)
        assert found.expected_ig == expected_ig(grid.frames, whole, miss)
        hidden = evaluate(grid, rig, surrogates=["expected_ig"], occlusion=True, **options)
        missed = log_miss(rig, roi, rays_by, grid.counts, FRAMES, 0.1, stride)
        assert hidden.expected_ig == expected_ig_with_occlusion(grid, missed)
