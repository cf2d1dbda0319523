"""Routes of simulated scenes: how long they are and which frames are kept."""

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lidarplace.configuration.settings import CountFromOne, Distance, Seconds, Settings

STEP_S = 0.05  # one simulation step: the sensors of the paper turn at 20 Hz
KEEP_M = 60.0
"""Boxes whose centre is farther from the ego are not logged; the ROI's far corner is 45 m away."""
TEST_EVERY = 10  # in the paper's split every tenth frame of a route is test
Part = Literal["train", "test"]


class RouteSettings(Settings):
    """The length of routes, and which of their frames are kept and for what."""

    frames_per_route: CountFromOne = Field(
        default=200, description="frames of every route; at most so many with min_travel_m"
    )
    frame_stride: CountFromOne = Field(default=10, description="record every n-th step of 20 Hz")
    min_travel_m: Distance = Field(
        default=0.0,
        description="skip frames until the ego has moved this far since the last kept frame, "
        "metres; the code released with the paper used 1 m",
    )
    warmup_s: Seconds = Field(
        default=30.0,
        description="simulated seconds before the first frame, in which traffic spreads out",
    )
    split: Literal["route", "paper"] = Field(
        "route",
        description="route: the routes of the test towns are test; paper: every tenth frame of "
        "every route, whichever town it comes from",
    )

    @property
    def warmup_steps(self) -> int:
        """Steps before the first recorded frame."""
        return math.ceil(self.warmup_s / STEP_S)


def split_of(split: Literal["route", "paper"], part: Part, frames: int) -> NDArray[np.str_]:
    """Assign the kept frames of a route to "train" or "test", shape (frames,).

    `part` is the purpose of the route, if routes are not divided."""
    if split == "route":
        return np.full(frames, part)
    tenth = np.arange(frames) % TEST_EVERY == TEST_EVERY - 1
    return np.where(tenth, "test", "train")


def seed_of(*key: int) -> int:
    """Derive a seed of 31 bits, as SUMO's tools and CARLA take them."""
    return int(np.random.SeedSequence(key).generate_state(1)[0] >> 1)
