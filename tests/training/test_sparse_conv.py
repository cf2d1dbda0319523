"""Sparse convolution against dense convolution, finite differences and a second way to pair."""

import pytest
import torch
from torch.nn import functional

from training.ops.sparse_conv import SparseConv3d, SparseTensor, SubmanifoldConv3d

STRIDED = [
    ((3, 3, 3), (2, 2, 2), (1, 1, 1)),
    ((3, 3, 3), (2, 2, 2), (0, 1, 1)),
    ((3, 1, 1), (2, 1, 1), (0, 0, 0)),
    ((2, 3, 1), (1, 2, 3), (1, 0, 0)),
]
GRIDS = [((5, 6, 7), 2, 0.3), ((4, 4, 4), 1, 1.0), ((3, 9, 1), 3, 0.5), ((6, 5, 5), 2, 0.02)]


def sites(shape, frames, share, channels=3, dtype=torch.float64):
    """Random features at about `share` of the cells; the last frame has none if there are more."""
    used = torch.rand(frames, *shape) < share
    used[frames - 1] &= frames == 1
    coordinates = torch.nonzero(used)
    return SparseTensor(
        torch.randn(len(coordinates), channels, dtype=dtype), coordinates, shape, frames
    )


def dense_weight(module):
    """Weights in the layout of conv3d: out, in, z, y, x."""
    return module.weight.permute(0, 4, 1, 2, 3)


def dense(x):
    """Features of all cells, shape (frames, C, nz, ny, nx)."""
    grid = x.features.new_zeros(x.frames, *x.shape, x.features.shape[1])
    return grid.index_put(tuple(x.coordinates.T), x.features).permute(0, 4, 1, 2, 3)


def at_sites(image, x):
    return image.permute(0, 2, 3, 4, 1)[tuple(x.coordinates.T)]


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("kernel", [(3, 3, 3), (1, 3, 5), (1, 1, 1)])
def test_submanifold_is_dense_convolution_at_the_sites(grid, kernel):
    torch.manual_seed(0)
    x = sites(*grid)
    module = SubmanifoldConv3d(3, 4, kernel).double()
    y = module(x)
    padding = [size // 2 for size in kernel]
    expected = functional.conv3d(dense(x), dense_weight(module), padding=padding)
    torch.testing.assert_close(y.features, at_sites(expected, x))
    assert y.coordinates is x.coordinates
    assert module(y.with_features(y.features[:, :3])).tables is x.tables


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize(("kernel", "stride", "padding"), STRIDED)
def test_strided_is_dense_convolution(grid, kernel, stride, padding):
    torch.manual_seed(0)
    x = sites(*grid)
    module = SparseConv3d(3, 4, kernel, stride, padding).double()
    y = module(x)
    expected = functional.conv3d(dense(x), dense_weight(module), stride=stride, padding=padding)
    assert (y.frames, 4, *y.shape) == expected.shape
    torch.testing.assert_close(dense(y), expected)
    # Every cell whose window holds a site, in order.
    used = (dense(x)[:, :1] != 0).double()
    reached = functional.conv3d(
        used, torch.ones(1, 1, *kernel, dtype=torch.float64), stride=stride, padding=padding
    )
    assert torch.equal(y.coordinates, torch.nonzero(reached[:, 0]))


def test_gradients_are_finite_differences():
    torch.manual_seed(0)
    x = sites((3, 4, 5), 2, 0.2)
    modules = [
        SubmanifoldConv3d(3, 2),
        *(SparseConv3d(3, 2, *geometry) for geometry in STRIDED[:3]),
    ]
    for module in modules:
        weight = torch.nn.Parameter(module.weight.detach().double())

        def output(features, weight, module=module):
            inputs = (x.with_features(features),)
            return torch.func.functional_call(module, {"weight": weight}, inputs).features

        assert torch.autograd.gradcheck(output, (x.features.requires_grad_(), weight))


def test_bev_stacks_the_heights_of_each_channel():
    torch.manual_seed(0)
    x = sites((2, 5, 6), 2, 0.4)
    assert torch.equal(x.bev(), dense(x).flatten(1, 2))
