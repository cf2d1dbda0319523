"""Random numbers that are counted, not drawn: each is a hash of what it is for."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner


def key_of(*parts: int) -> NDArray[np.uint64]:
    """Return the key of `stream_of` for whole numbers: seed, frame and index of the LiDAR."""
    return np.array([value % 2**64 for value in parts], np.uint64)


@inner
def _mix(state):
    """Return the output function of splitmix64 (Steele, Lea, Flood 2014), which scatters bits."""
    z = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@inner
def stream_of(key):
    """Return the stream of numbers of a key."""
    stream = np.uint64(0)
    for part in key:
        stream = _mix((stream ^ part) + np.uint64(0x9E3779B97F4A7C15))
    return stream


@inner
def uniform(stream, counter):
    """Return the `counter`-th number of a splitmix64 stream.

    It is an odd multiple of 2**-53 in (0, 1)."""
    bits = _mix(stream + (counter + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15))
    return (np.float64(np.int64(bits >> np.uint64(12))) + 0.5) * 2.0**-52
