"""Settings of a simulated traffic scene."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

STEP_S = 0.05
"""One simulation step: the sensors of the paper turn at 20 Hz."""

TEST_EVERY = 10
"""In the paper's split every tenth frame of a route is test."""


class SumoScene(BaseModel):
    """A town, its traffic, and which drives through it are recorded.

    Training and test routes are recorded in two towns with their own traffic, so nothing of a
    test route is seen in training.

    Attributes:
        source: tells this kind of scene from others in a configuration.
        seed: decides towns, traffic and sizes; the same seed gives the same log to the byte.
        density: vehicles in each town; the paper's are 40, 80 and 120.
        pedestrians: pedestrians in each town.
        routes: egos recorded in the training town.
        test_routes: egos recorded in the test town.
        frames_per_route: frames of every route.
        frame_stride: record every n-th step of 20 Hz.
        warmup_s: simulated seconds before the first frame, in which traffic spreads out.
        split: "route" calls the routes of the test town test; "paper" calls every tenth frame of
            every route test, whichever town it comes from.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    source: Literal["sumo"] = "sumo"
    seed: int = Field(default=0, ge=0)
    density: int = Field(default=80, ge=1)
    pedestrians: int = Field(default=60, ge=0)
    routes: int = Field(default=8, ge=1)
    test_routes: int = Field(default=4, ge=0)
    frames_per_route: int = Field(default=200, ge=1)
    frame_stride: int = Field(default=10, ge=1)
    warmup_s: float = Field(default=30.0, ge=0.0, allow_inf_nan=False)
    split: Literal["route", "paper"] = "route"

    @property
    def name(self) -> str:
        """The scene's name in a box log."""
        return f"sumo-{self.seed}"

    def frame_counts(self) -> tuple[int, int]:
        """Number of training and of test frames."""
        if self.split == "route":
            return self.routes * self.frames_per_route, self.test_routes * self.frames_per_route
        routes, test = self.routes + self.test_routes, self.frames_per_route // TEST_EVERY
        return routes * (self.frames_per_route - test), routes * test

    @property
    def warmup_steps(self) -> int:
        """Steps before the first recorded frame."""
        return math.ceil(self.warmup_s / STEP_S)

    @property
    def seconds(self) -> float:
        """Simulated time of one town, warm-up included."""
        return (self.warmup_steps + self.frames_per_route * self.frame_stride) * STEP_S
