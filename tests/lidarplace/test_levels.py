import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.coverage.bits import empty, exchange_columns, pack, unpack
from lidarplace.coverage.tiles import Tiles
from lidarplace.pog.occupancy.levels import Levels

shapes = st.tuples(st.integers(1, 40), st.integers(1, 70), st.integers(1, 140))


@given(shapes, st.integers(0, 2**32 - 1), st.floats(0, 1))
@settings(max_examples=60)
def test_bits_are_the_mask(shape, seed, share):
    mask = np.random.default_rng(seed).random(shape) < share
    bits = pack(mask)
    assert bits.shape == empty(shape).shape
    np.testing.assert_array_equal(unpack(bits, shape[2]), mask)
    assert np.bitwise_count(bits).sum() == np.count_nonzero(mask)
    exchanged = exchange_columns(bits, shape[2])
    np.testing.assert_array_equal(exchanged, pack(mask.swapaxes(1, 2)))
    np.testing.assert_array_equal(unpack(exchanged, shape[1]), mask.swapaxes(1, 2))


@given(shapes, st.integers(0, 2**32 - 1), st.sampled_from([2, 5, 1000]))
@settings(max_examples=60)
def test_covered_voxels_by_count(shape, seed, most):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, most, shape).astype(np.int32)
    mask = rng.random(shape) < 0.4
    levels = Levels.of_counts(counts)
    np.testing.assert_array_equal(levels.counts, np.setdiff1d(counts, [0]))
    expected = np.bincount(counts[mask], minlength=counts.max() + 1)[levels.counts]
    np.testing.assert_array_equal(levels.covered(pack(mask)), expected)
    np.testing.assert_array_equal(levels.total, np.bincount(counts.ravel())[levels.counts])
    # Each occupied voxel is in one set.
    assert np.bitwise_count(levels.voxels).sum() == np.count_nonzero(counts)


def spread(tiles, shape):
    """The voxels that matter to the tiles of a grid."""
    i, j, k = np.indices(shape)
    low, high = tiles.lowest[i // 16, j // 32], tiles.highest[i // 16, j // 32]
    return (low <= k) & (k <= high)


@given(shapes, st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-4, 1e-2]))
@settings(max_examples=40)
def test_tiles_hold_all_that_matters(shape, seed, share):
    rng = np.random.default_rng(seed)
    mask, other = rng.random(shape) < share, rng.random(shape) < share
    tiles = Tiles.of_voxels(mask)
    assert not (mask & ~spread(tiles, shape)).any()
    assert not ((mask | other) & ~spread(tiles | Tiles.of_voxels(other), shape)).any()
    # Columns along x of the grid (y, z, x), along y of the grid (x, z, y).
    for axis, axes in ((0, (1, 2, 0)), (1, (0, 2, 1)), (2, (0, 1, 2))):
        turned_shape = tuple(shape[a] for a in axes)
        along = spread(tiles.along(axis, shape), turned_shape)
        assert not (mask.transpose(axes) & ~along).any()
        if not mask.any():
            assert not along.any()
    assert spread(Tiles.whole(shape), shape).all()
