"""What a sweep writes as `sweep.json`: what was compared, on how much, and how to do it again."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, ConfigDict, Field, FiniteFloat

from lidarplace.configuration.settings import Count, CountFromOne
from lidarplace.placement import Mount
from lidarplace.roi import Roi
from tracking.run_folders.json_file import Part

Pose = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]


class Frames(Part):
    """How many frames there are of each split."""

    train: Count
    test: Count


def _sets(rung: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(rung.get("set"), dict):
        raise ValueError("a rung has a mapping of keys `set`")
    return rung


class SweepResult(Part):
    """`sweep.json`; lengths in metres, angles in radians. Run folders of before lack the last keys.

    Attributes:
        command: the line that ran the sweep.
        axes: of the grid, beyond the placement.
        placements: x, y, z, roll, pitch, yaw of every mount, by the placement's name.
        roi: the region of interest.
        promote: what each rung ranked by, kept and set.
        pictured: of which setting maps, frames and clouds are, by axis.
        cores: that the sweep had.
        seconds: of the last command.
    """

    model_config = ConfigDict(extra="allow")  # the report shows all that the file says

    name: str
    command: str
    axes: tuple[str, ...]
    placements: dict[str, tuple[Pose, ...]]
    classes: Annotated[tuple[str, ...], Field(min_length=1)]
    roi: Roi
    frames: Frames
    promote: tuple[Annotated[dict[str, Any], AfterValidator(_sets)], ...] = ()
    pictured: dict[str, str | int | float | bool | None] = Field({})
    cores: CountFromOne | None = None
    seconds: Annotated[FiniteFloat, Field(ge=0)] | None = None

    @property
    def rigs(self) -> dict[str, tuple[Mount, ...]]:
        """The mounts by the placement's name."""
        return {name: tuple(Mount(*m) for m in mounts) for name, mounts in self.placements.items()}
