"""Keypoints and their features against loops; without points."""

import itertools

import numpy as np
import torch

from tests.training.plain_layers import ball_features, waken
from training.detectors.backbones.set_abstraction import BallSettings
from training.detectors.backbones.voxel_set_abstraction import (
    SCALES,
    KeypointSettings,
    VoxelSetAbstraction,
    mixed,
)
from training.detectors.backbones.voxels import VoxelGrid
from training.ops.sparse_conv import SparseTensor

SMALL = KeypointSettings(
    keypoints=6,
    raw_points=BallSettings((0.5, 1.5), (2, 4), ((3, 5), (4,))),
    scales=(
        BallSettings((0.4,), (3,), ((4,),)),
        BallSettings((0.7, 1.0), (3, 2), ((4,), (3, 2))),
        BallSettings((1.2,), (4,), ((2,),)),
        BallSettings((2.0,), (2,), ((3,),)),
    ),
    outputs=7,
)
CHANNELS = (2, 3, 1, 4)
GRID = VoxelGrid((0.0, -2.0, 0.0, 4.0, 2.0, 1.6), (0.2, 0.2, 0.2))


def small(seed=0):
    """A module whose batch norms are no identity, in evaluation mode, float64."""
    torch.manual_seed(seed)
    return waken(VoxelSetAbstraction(SMALL, GRID, CHANNELS, bev=3).double())


def scene(counts, seed=0):
    """Points, voxels at random sites of every scale, and an image."""
    random = np.random.default_rng(seed)
    clouds = [
        torch.from_numpy(random.uniform((0, -2, 0, 0), (4, 2, 1.6, 1), (n, 4)).astype(np.float32))
        for n in counts
    ]
    scales = {}
    for (name, stride), channels in zip(SCALES.items(), CHANNELS, strict=True):
        shape = tuple(-(-size // stride) for size in GRID.cells)
        dense = random.random((len(counts), *shape)) < 0.2
        dense[np.array(counts) == 0] = False
        sites = torch.from_numpy(np.argwhere(dense))
        features = torch.from_numpy(random.standard_normal((len(sites), channels)))
        scales[name] = SparseTensor(features, sites, shape, len(counts))
    bev = torch.from_numpy(random.standard_normal((len(counts), 3, 3, 3)))
    return clouds, scales, bev


def test_features_are_those_of_loops():
    module = small()
    clouds, scales, bev = scene([40, 0, 25])
    with torch.no_grad():
        keypoints = module(torch.cat(clouds), [40, 0, 25], scales, bev)
    assert keypoints.counts == [6, 0, 6]
    assert keypoints.sources.shape == (12, module.inputs)
    for k, (frame, place) in enumerate(
        zip(np.repeat(range(3), keypoints.counts), keypoints.xyz, strict=True)
    ):
        cloud = clouds[frame].double()
        assert (cloud[:, :3] == place).all(dim=1).any()
        x, y = ((place[:2] - torch.tensor([0.0, -2.0])) / 1.6).tolist()
        expected = [bilinear(bev[frame], x, y)]
        expected.append(ball_features(module.SA_rawpoints, cloud[:, :3], cloud[:, 3:], place))
        for (name, stride), layer in zip(SCALES.items(), module.SA_layers, strict=True):
            of_frame = scales[name].coordinates[:, 0] == frame
            site = scales[name].coordinates[of_frame][:, [3, 2, 1]]
            centres = (site + 0.5) * 0.2 * stride + torch.tensor([0.0, -2.0, 0.0]).double()
            expected.append(ball_features(layer, centres, scales[name].features[of_frame], place))
        torch.testing.assert_close(keypoints.sources[k], torch.cat(expected), rtol=1e-6, atol=1e-6)
    assert (keypoints.sources > 0).double().mean() > 0.5
    assert keypoints.features.shape == (12, 7)


def bilinear(image, x, y):
    """Sample an image (C, ny, nx) at one place, with features at the cells' lower corners."""
    ny, nx = image.shape[1:]
    total = torch.zeros(len(image)).double()
    for j, i in itertools.product(range(ny), range(nx)):
        total += image[:, j, i] * max(0.0, 1 - abs(x - i)) * max(0.0, 1 - abs(y - j))
    # Beyond the last row or column OpenPCDet's weights cancel.
    return total * (x <= nx - 1) * (y <= ny - 1)


def test_mixed_voxels_are_the_same_in_an_order_of_their_places():
    _, scales, _ = scene((30, 0, 40))
    voxels = scales["x_conv1"]
    shuffled = mixed(voxels)
    assert (shuffled.coordinates[:, 0].diff() >= 0).all()
    row = {tuple(site): i for i, site in enumerate(voxels.coordinates.tolist())}
    rows = [row[tuple(site)] for site in shuffled.coordinates.tolist()]
    assert sorted(rows) == list(range(len(voxels.coordinates)))
    assert torch.equal(shuffled.features, voxels.features[rows])
    # A ball keeps the first of them: those must not be the lowest.
    first = shuffled.coordinates[shuffled.coordinates[:, 0] == 0]
    half = len(first) // 2
    assert abs(first[:half, 1].double().mean() - first[half:, 1].double().mean()) < 1
