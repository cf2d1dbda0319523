"""Sparse convolution against dense convolution, on the CPU and by the kernels of a GPU."""

import pytest
import torch
from torch.nn import functional

from tests.training.other_device import other_device
from training.ops.gpu import sparse_conv, sparse_rules
from training.ops.sparse_conv import SparseConv3d, SparseTensor, SubmanifoldConv3d

STRIDED = [
    ((3, 3, 3), (2, 2, 2), (1, 1, 1)),
    ((3, 3, 3), (2, 2, 2), (0, 1, 1)),
    ((3, 1, 1), (2, 1, 1), (0, 0, 0)),
    ((2, 3, 1), (1, 2, 3), (1, 0, 0)),
]
GRIDS = [((5, 6, 7), 2, 0.3), ((4, 4, 4), 1, 1.0), ((3, 9, 1), 3, 0.5), ((6, 5, 5), 2, 0.02)]


@pytest.fixture(params=["cpu", "other"])
def place(request):
    """Device of the convolution: the CPU, and the one that stands for a GPU."""
    if request.param == "cpu":
        yield torch.device("cpu")
    else:
        with other_device() as device:
            yield device


def sites(shape, frames, share, channels=3, dtype=torch.float64):
    """Random features at about `share` of the cells; the last frame has none if there are more."""
    used = torch.rand(frames, *shape) < share
    used[frames - 1] &= frames == 1
    coordinates = torch.nonzero(used)
    features = torch.randn(len(coordinates), channels, dtype=dtype)
    return SparseTensor(features, coordinates, shape, frames)


def on(place, x):
    return SparseTensor(x.features.to(place), x.coordinates.to(place), x.shape, x.frames)


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
def test_submanifold_is_dense_convolution_at_the_sites(grid, kernel, place):
    torch.manual_seed(0)
    x = sites(*grid)
    module = SubmanifoldConv3d(3, 4, kernel).double()
    padding = [size // 2 for size in kernel]
    expected = functional.conv3d(dense(x), dense_weight(module), padding=padding)
    there = on(place, x)
    y = module.to(place)(there)
    torch.testing.assert_close(y.features.cpu(), at_sites(expected, x))
    assert y.coordinates is there.coordinates
    assert module(y.with_features(y.features[:, :3])).tables is there.tables


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize(("kernel", "stride", "padding"), STRIDED)
def test_strided_is_dense_convolution(grid, kernel, stride, padding, place):
    torch.manual_seed(0)
    x = sites(*grid)
    module = SparseConv3d(3, 4, kernel, stride, padding).double()
    expected = functional.conv3d(dense(x), dense_weight(module), stride=stride, padding=padding)
    y = on(torch.device("cpu"), module.to(place)(on(place, x)))
    assert (y.frames, 4, *y.shape) == expected.shape
    torch.testing.assert_close(dense(y), expected)
    # Every cell whose window holds a site, in order.
    used = (dense(x)[:, :1] != 0).double()
    reached = functional.conv3d(
        used, torch.ones(1, 1, *kernel, dtype=torch.float64), stride=stride, padding=padding
    )
    assert torch.equal(y.coordinates, torch.nonzero(reached[:, 0]))


@pytest.mark.parametrize("grid", [GRIDS[0], ((3, 4, 5), 1, 0.03), ((3, 4, 4), 1, 0.0)])
@pytest.mark.parametrize("geometry", [None, *STRIDED[1:]])
def test_gradients_are_those_of_dense_convolution(grid, geometry, place):
    torch.manual_seed(0)
    x = sites(*grid)
    stride, padding = geometry[1:] if geometry else (1, 1)
    module = SparseConv3d(3, 4, *geometry) if geometry else SubmanifoldConv3d(3, 4)
    module.double()
    features = x.features.requires_grad_()
    image = functional.conv3d(dense(x), dense_weight(module), stride=stride, padding=padding)
    factors = torch.randn_like(image)
    # Of a submanifold convolution the sites alone have a result.
    used = torch.ones_like(image) if geometry else dense(x.with_features(torch.ones_like(features)))
    (image * factors * used[:, :1]).sum().backward()
    expected = [features.grad, module.weight.grad]
    module.zero_grad()
    there = on(place, x.with_features(features.detach()))
    y = module.to(place)(there.with_features(there.features.requires_grad_()))
    at = at_sites(factors, on(torch.device("cpu"), y)).to(place)
    (y.features * at).sum().backward()
    for gradient, wanted in zip((there.features.grad, module.weight.grad), expected, strict=True):
        torch.testing.assert_close(gradient.cpu(), wanted)


@pytest.mark.parametrize(
    ("dtype", "tolerance"), [(torch.float32, 1e-5), (torch.float16, 4e-3), (torch.bfloat16, 3e-2)]
)
def test_kernels_with_several_blocks(dtype, tolerance, monkeypatch):
    """Kernels with blocks of a few rows, in 16 bits too, against the CPU in 64 bits."""
    torch.manual_seed(0)
    x = sites((5, 6, 7), 3, 0.3, channels=20)
    x = x.with_features(x.features.to(dtype).double())
    module = SparseConv3d(20, 40, *STRIDED[0])
    module.weight.data = module.weight.detach().to(dtype).double()
    results = []
    with other_device() as place:
        for constant, size in (("_ROWS", 32), ("_OUTPUTS", 32), ("_PORTION", 64)):
            monkeypatch.setattr(sparse_conv, constant, size)
        monkeypatch.setattr(sparse_rules, "_LANES", 512)
        for device, kind in ((torch.device("cpu"), torch.float64), (place, dtype)):
            there = on(device, x)
            features = there.features.detach().to(kind).requires_grad_()
            module.to(device, kind).zero_grad()
            y = module(there.with_features(features))
            y.features.sum().backward()
            gradients = (features.grad, module.weight.grad)
            assert {item.dtype for item in (y.features, *gradients)} == {kind}
            results.append([item.cpu().double() for item in (y.features, *gradients)])
            assert len(y.coordinates) > 64
    for ours, expected in zip(*reversed(results), strict=True):
        error = (ours - expected).abs().max() / expected.abs().max()
        assert error < tolerance


def test_bev_stacks_the_heights_of_each_channel():
    torch.manual_seed(0)
    x = sites((2, 5, 6), 2, 0.4)
    assert torch.equal(x.bev(), dense(x).flatten(1, 2))
