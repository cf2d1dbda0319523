"""Random numbers by purpose, so that trainings of one seed under several rigs stay paired."""

from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """Purpose of a draw. Each has a stream of its own; the numbers are part of results."""

    ORDER = 0  # the order of the frames of an epoch
    NETWORK = 1  # what the network draws in a step: samples of points and of RoIs
    PASTE = 2  # objects of other frames that are put into a frame
    MOVE = 3  # how a frame is mirrored, turned and scaled
    SHUFFLE = 4  # the order of the points of a frame


def stream(purpose: Purpose, *key: int) -> np.random.SeedSequence:
    """The source of randomness for `purpose` at `key`: seed, epoch, and frame or step.

    Streams of different purposes or keys are independent (NumPy's SeedSequence). So what one of
    them draws, and how much, changes nothing in the others: under every rig the same frame of the
    same epoch is mirrored, turned and scaled alike, though the rigs' points differ in number."""
    return np.random.SeedSequence(key, spawn_key=(purpose,))


def generator(purpose: Purpose, *key: int) -> np.random.Generator:
    """A generator of `stream(purpose, *key)`."""
    return np.random.default_rng(stream(purpose, *key))
