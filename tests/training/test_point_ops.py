"""Sampling, neighbour searches and interpolation: OpenPCDet's kernels, brute force, gradients.

tests/data/training_ops.npz: inputs and outputs of OpenPCDet's CUDA kernels, recorded at commit
8cacccec (Apache-2.0). Each search has a kernel for CPUs and one for GPUs, interpreted here.
"""

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from torch.utils._python_dispatch import TorchDispatchMode

from training.ops import voxel_query
from training.ops.ball_query import _query_numba, _query_triton
from training.ops.grouping import group
from training.ops.interpolation import (
    _nearest_numba,
    _nearest_triton,
    interpolate,
    inverse_distance_weights,
)
from training.ops.sampling import _furthest_numba, _furthest_triton, furthest_point_sample
from training.ops.voxel_query import OccupiedVoxels

DATA = np.load(Path(__file__).parents[1] / "data" / "training_ops.npz")
POINTS = torch.from_numpy(DATA["points"])
BATCH = torch.tensor([1500, 1500])
STACK = torch.tensor([1400, 1600])

SAMPLING = (_furthest_numba, _furthest_triton)
BALLS = (_query_numba, _query_triton)
NEAREST = (_nearest_numba, _nearest_triton)
VOXELS = (voxel_query._query_numba, voxel_query._query_triton)


def of(name):
    return torch.from_numpy(DATA[name].astype(np.int64))


# A coarse lattice has ties, points at exactly the radius and duplicates.
def clouds(least=1, most=60):
    lattice = arrays(np.int8, st.tuples(st.integers(least, most), st.just(3)),
                     elements=st.integers(-4, 4))  # fmt: skip
    return lattice.map(lambda grid: torch.from_numpy(grid * np.float32(0.5)))


# Frames from empty to far larger than the others; a seed fills them from the lattice.
sizes = st.lists(st.one_of(st.integers(0, 12), st.integers(0, 2500)), max_size=30)


def lattice_points(count, seed):
    grid = np.random.default_rng(seed).integers(-2, 3, (count, 3))
    return torch.from_numpy(grid * np.float32(0.5))


class Operations(TorchDispatchMode):
    """Names of the operations in a block."""

    def __init__(self):
        super().__init__()
        self.names = []

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        self.names.append(func.overloadpacket.__name__)
        return func(*args, **(kwargs or {}))


def distances(a, b):
    """Squared, added up as the kernels do."""
    dx, dy, dz = (a[:, None, axis] - b[None, :, axis] for axis in range(3))
    return dx * dx + dy * dy + dz * dz


def assert_first_hits(result, mask, samples):
    """Rows, and whether there is none, of the first true entries of each row of the mask."""
    idx, empty = result
    assert idx.shape == (len(mask), samples)
    for rows, near, none in zip(idx.tolist(), mask, empty.tolist(), strict=True):
        hits = near.nonzero().flatten().tolist()[:samples]
        assert rows == (hits + hits[:1] * (samples - len(hits)) if hits else [0] * samples)
        assert none == (not hits)


# Furthest point sampling


@pytest.mark.parametrize("search", SAMPLING)
def test_sampling_agrees_with_openpcdet(search):
    rows = search(POINTS, BATCH.tolist(), 128).view(2, 128)
    assert torch.equal(rows, of("fps_batch") + torch.tensor([[0], [1500]]))
    rows = torch.cat([search(POINTS[:1400], [1400], 64), 1400 + search(POINTS[1400:], [1600], 96)])
    assert torch.equal(rows, of("fps_stack"))


def upstream_sampling(xyz, samples):
    """OpenPCDet's kernel, thread by thread."""
    count = len(xyz)
    threads = min(2 ** int(np.log2(count)), 1024)
    nearest = torch.full((count,), torch.inf)
    chosen = [0]
    while len(chosen) < samples:
        nearest = torch.minimum(nearest, distances(xyz[chosen[-1:]], xyz)[0])
        best = []
        for thread in range(threads):
            of_thread = nearest[thread::threads]
            best.append((of_thread.max().item(), thread + threads * of_thread.argmax().item()))
        while len(best) > 1:
            half = len(best) // 2
            best = [
                high if high[0] > low[0] else low
                for low, high in zip(best[:half], best[half:], strict=True)
            ]
        chosen.append(best[0][1])
    return chosen


@settings(max_examples=60)
@given(clouds(1, 150), st.integers(1, 20))
def test_sampling_breaks_ties_as_upstream(xyz, samples):
    distinct = min(samples, len(xyz))
    expected = np.resize(upstream_sampling(xyz, distinct), samples).tolist()
    for search in SAMPLING:
        assert search(xyz, [len(xyz)], samples).tolist() == expected


@pytest.mark.parametrize("search", SAMPLING)
def test_sampling_of_small_and_empty_frames(search):
    line = torch.tensor([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    assert search(line, [0, 3, 0], 7).tolist() == [0, 2, 1, 0, 2, 1, 0]
    assert search(line, [1, 2], 3).tolist() == [0, 0, 0, 1, 2, 1]
    assert search(line[:0], [0, 0], 4).tolist() == search(line[:0], [], 4).tolist() == []
    # Nothing is further than anything else.
    assert search(torch.zeros(5, 3), [5], 4).tolist() == [0, 0, 0, 0]
    assert furthest_point_sample(line, [0, 2, 0, 1], 5)[1] == [0, 5, 0, 5]


@settings(max_examples=5)
@given(sizes, st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_sampling_of_many_frames_is_the_same_on_both_paths(counts, samples, seed):
    xyz = lattice_points(sum(counts), seed)
    rows = _furthest_triton(xyz, counts, samples)
    assert torch.equal(rows, _furthest_numba(xyz, counts, samples))


def few_samples(xyz, counts):
    return _furthest_triton(xyz, counts.tolist(), 3)


def few_in_balls(xyz, counts):
    return _query_triton(0.3, 4, xyz, counts, xyz, counts)


def nearest_of_few(xyz, counts):
    return _nearest_triton(xyz, counts, xyz, counts)


@pytest.mark.parametrize("search", [few_samples, few_in_balls, nearest_of_few])
def test_a_gpu_makes_as_many_operations_for_many_frames(search):
    seen = []
    for frames in (2, 40):
        with Operations() as operations:
            search(torch.rand(9 * frames, 3), torch.full((frames,), 9))
        seen.append(operations.names)
    assert seen[0] == seen[1]
    assert "nonzero" not in seen[0]  # waits for the GPU


# Ball query


@pytest.mark.usefixtures("large_blocks")
@pytest.mark.parametrize("search", BALLS)
@pytest.mark.parametrize(("radius", "samples"), [(0.8, 16), (2.4, 32)])
def test_ball_query_agrees_with_openpcdet_stack(search, radius, samples):
    new, counts = torch.from_numpy(DATA["new_points"]), of("new_counts")
    idx, empty = search(radius, samples, POINTS, STACK, new, counts)
    start = torch.repeat_interleave(torch.tensor([0, 1400]), counts)[:, None]
    expected_empty = torch.from_numpy(DATA[f"ball_stack_empty_{radius}_{samples}"])
    expected = of(f"ball_stack_{radius}_{samples}") + start
    assert torch.equal(empty, expected_empty)
    assert torch.equal(idx, torch.where(empty[:, None], 0, expected))
    assert empty.any()


@settings(max_examples=60)
@given(clouds(0), clouds(0), clouds(0, 20), st.sampled_from([0.4, 0.5, 1.0, 1.7, 30.0]),
       st.integers(1, 9))  # fmt: skip
def test_ball_query_takes_the_first_within_the_radius(first, second, new, radius, samples):
    xyz, counts = torch.cat([first, second]), torch.tensor([len(first), len(second)])
    new, new_counts = torch.cat([new, 5 * new]), torch.tensor([len(new), len(new)])
    inside = distances(new, xyz) < np.float32(radius) * np.float32(radius)
    inside[: len(new) // 2, len(first) :] = False
    inside[len(new) // 2 :, : len(first)] = False
    for search in BALLS:
        assert_first_hits(search(radius, samples, xyz, counts, new, new_counts), inside, samples)


@settings(max_examples=12)
@given(
    st.data(),
    st.lists(st.sampled_from([0, 1, 30, 300]), max_size=6),
    st.sampled_from([np.float32, np.float64]),
    st.integers(0, 2**32 - 1),
)
def test_many_frames_are_the_same_on_both_paths(data, counts, dtype, seed):
    """Distances of 0.1 and their multiples: ties, and points at exactly the radius."""
    new_counts = data.draw(st.lists(st.integers(0, 9), min_size=len(counts), max_size=len(counts)))
    radius, samples = data.draw(st.sampled_from([0.1, 0.2, 9.0])), data.draw(st.integers(1, 9))
    random = np.random.default_rng(seed)
    xyz, new = (
        torch.from_numpy(random.integers(-2, 3, (sum(of), 3)).astype(dtype) * dtype(0.1))
        for of in (counts, new_counts)
    )
    counts, new_counts = (
        torch.tensor(values, dtype=torch.int64) for values in (counts, new_counts)
    )
    expected, result = (search(radius, samples, xyz, counts, new, new_counts) for search in BALLS)
    assert all(map(torch.equal, expected, result))
    expected, result = (search(new, new_counts, xyz, counts) for search in NEAREST)
    torch.testing.assert_close(result[0], expected[0], rtol=3e-7, atol=0)
    assert torch.equal(result[1], expected[1])


def test_ball_query_of_far_points():
    xyz = torch.tensor([[0.0, 0, 0], [1e7, 0, 0], [1e7, 0, 1e7], [-1e12, 1e12, 0]])
    new = torch.cat([xyz, torch.tensor([[1e30, -1e30, 0.0]])])
    for search in BALLS:
        idx, empty = search(0.5, 1, xyz, torch.tensor([4]), new, torch.tensor([5]))
        assert idx.flatten().tolist() == [0, 1, 2, 3, 0]
        assert empty.tolist() == [False] * 4 + [True]


# Three nearest neighbours


@pytest.mark.usefixtures("last_bits", "large_blocks")
@pytest.mark.parametrize("search", NEAREST)
def test_three_nn_agrees_with_openpcdet(search):
    new = (of("fps_batch") + torch.tensor([[0], [1500]])).flatten()
    distance, idx = search(POINTS, BATCH, POINTS[new], torch.tensor([128, 128]))
    expected = of("nn_batch_idx") + torch.tensor([0, 128])[:, None, None]
    assert torch.equal(idx, expected.flatten(0, 1))
    assert distance.numpy() == pytest.approx(DATA["nn_batch_distances"].reshape(-1, 3), abs=2e-6)
    features = torch.from_numpy(DATA["nn_features"]).transpose(1, 2).flatten(0, 1)
    weights = inverse_distance_weights(distance)
    result = interpolate(features, idx, weights)
    expected = DATA["nn_interpolated"].transpose(0, 2, 1).reshape(-1, 2)
    assert result.numpy() == pytest.approx(expected, abs=1e-6)
    new, counts = torch.from_numpy(DATA["new_points"]), of("new_counts")
    distance, idx = search(new, counts, POINTS, STACK)
    assert torch.equal(idx, of("nn_stack_idx"))
    assert distance.numpy() == pytest.approx(DATA["nn_stack_distances"], rel=1e-6)


@pytest.mark.usefixtures("last_bits")
@settings(max_examples=60)
@given(clouds(0, 20), clouds(1, 40))
def test_nearest_by_brute_force(new, places):
    near = min(3, len(places))
    counts = [torch.tensor([0, len(of)]) for of in (new, places)]
    squared = distances(new, places)
    expected, rows = squared.sort(dim=1, stable=True)
    for search in NEAREST:
        distance, idx = search(new, counts[0], places, counts[1])
        # A library's root may be one unit in the last place off.
        torch.testing.assert_close(distance[:, :near], expected[:, :3].sqrt(), rtol=3e-7, atol=0)
        assert torch.equal(idx[:, :near], rows[:, :3])


@pytest.mark.parametrize("three_nn", NEAREST)
def test_three_nn_with_fewer_than_three_points(three_nn):
    new = torch.tensor([[0.0, 0, 0], [2, 0, 0], [5, 0, 0], [6, 0, 0]])
    places = torch.tensor([[1.0, 0, 0], [4, 0, 0], [8, 0, 0]])
    distance, idx = three_nn(new, torch.tensor([1, 1, 2, 0]), places, torch.tensor([1, 0, 2, 0]))
    inf = torch.inf
    assert distance.tolist() == [[1, inf, inf], [inf] * 3, [1, 3, inf], [2, 2, inf]]
    assert idx.tolist() == [[0, 0, 0], [0, 0, 0], [1, 2, 0], [1, 2, 0]]
    weights = inverse_distance_weights(distance)
    assert weights[0].tolist() == [1, 0, 0]
    assert weights[1].tolist() == [0, 0, 0]
    assert weights[2].tolist() == pytest.approx([0.75, 0.25, 0])
    features = torch.eye(3)
    assert interpolate(features, idx, weights)[3].tolist() == [0, 0.5, 0.5]
    nothing = interpolate(features[:0], idx, weights)
    assert torch.equal(nothing, torch.zeros(4, 3))


# Voxel query


@pytest.mark.usefixtures("large_blocks")
@pytest.mark.parametrize("search", VOXELS)
def test_voxel_query_agrees_with_openpcdet(search):
    coordinates = torch.nn.functional.pad(of("voxel_zyx"), (1, 0))
    shape = tuple(DATA["voxel_shape"].tolist())
    voxels = OccupiedVoxels(torch.from_numpy(DATA["voxel_xyz"]), coordinates, shape)
    new_xyz = torch.from_numpy(DATA["voxel_new_xyz"])
    idx, empty = search((4, 4, 4), 1.2, 16, voxels, new_xyz, of("voxel_new"))
    assert torch.equal(idx, of("voxel_idx"))
    assert torch.equal(empty, torch.from_numpy(DATA["voxel_empty"]))


occupied_cells = st.lists(
    st.tuples(st.integers(0, 2), st.integers(0, 3), st.integers(0, 4), st.integers(0, 5)),
    max_size=60, unique=True,
)  # fmt: skip
queries = st.lists(
    st.tuples(st.integers(0, 4), st.integers(-2, 5), st.integers(-2, 6), st.integers(-2, 7)),
    max_size=12,
)


@settings(max_examples=60)
@given(
    occupied_cells,
    queries,
    st.tuples(*[st.integers(0, 2)] * 3),
    st.sampled_from([0.5, 1.0, 1.5, 9.0]),
    st.integers(1, 9),
    st.sampled_from([torch.float32, torch.float64]),
)
def test_voxel_query_by_brute_force(occupied, new, reach, radius, samples, dtype):
    coordinates = torch.tensor(sorted(occupied), dtype=torch.int64).view(-1, 4)
    new = torch.tensor(new, dtype=torch.int64).view(-1, 4)
    # A point need not lie at the centre of its voxel, and may lie at exactly the radius.
    xyz, new_xyz = coordinates[:, [3, 2, 1]].to(dtype), new[:, [3, 2, 1]].to(dtype) + 0.5
    steps = (new[:, None] - coordinates).abs()
    allowed = (steps <= torch.tensor([0, *reach])).all(dim=2)
    allowed &= distances(new_xyz, xyz) <= radius**2
    for search in VOXELS:
        voxels = OccupiedVoxels(xyz, coordinates, (4, 5, 6))
        result = search(reach, radius, samples, voxels, new_xyz, new)
        assert_first_hits(result, allowed, samples)


# Features


def test_gradients_reach_the_features():
    features = torch.rand(6, 3, dtype=torch.float64, requires_grad=True)
    idx = torch.tensor([[0, 0, 5], [1, 2, 2], [4, 1, 0], [0, 0, 0]])
    weights = torch.rand(4, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda rows: group(rows, idx), (features,))
    assert torch.autograd.gradcheck(
        lambda rows, by: interpolate(rows, idx, by), (features, weights)
    )
