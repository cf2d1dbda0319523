"""Result file of a sweep, `sweep.json`: what was compared, on how much, and how to repeat it."""

from functools import cached_property
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, ConfigDict, Field, FiniteFloat, model_validator

from lidarplace.base.roi import Roi
from lidarplace.configuration.renamed_keys import current_key, with_current_keys
from lidarplace.configuration.settings import Count, CountFromOne
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Mount
from tracking.run_folders.json_file import (
    Boxes,
    Part,
    ResultFile,
    Surroundings,
    Triangles,
    drawn_vehicle,
)

_Numbers = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]


def _possible(pose: _Numbers) -> _Numbers:
    Mount(*pose)  # raises ValueError for angles in degrees
    return pose


Pose = Annotated[_Numbers, AfterValidator(_possible)]


class Frames(Part):
    """Number of frames of each split."""

    train: Count
    test: Count


class Rung(Part):
    """Step of `promote`, as the configuration has it."""

    by: str
    keep: CountFromOne
    object_class: str | None = Field(None, alias="class")
    direction: str | None = None
    set: dict[str, Any]  # key path -> value of its trainings


class LidarModel(Part):
    """LiDAR model; angles in degrees."""

    name: str | None = None  # of the catalogue
    price_usd: Annotated[FiniteFloat, Field(gt=0)] | None = None  # what a source asked for one
    beams: CountFromOne
    elevation_deg: tuple[FiniteFloat, FiniteFloat]  # of the lowest and of the highest beam
    azimuth_steps: CountFromOne  # firings of a beam in one turn


class Anchor(Part):
    """Size that detectors start from, of a class that the preset does not define; metres."""

    name: str  # of the class
    size: tuple[FiniteFloat, FiniteFloat, FiniteFloat]  # length, width, height
    bottom: FiniteFloat  # height of its underside above the ground


class SweepResult(ResultFile):
    """Content of `sweep.json`; lengths in metres, angles in radians; older ones lack last keys."""

    FILE: ClassVar[str] = "sweep.json"
    model_config = ConfigDict(extra="allow")  # the report shows all that the file says

    name: str
    """Name of the sweep."""
    command: str
    """Command that ran the sweep."""
    axes: tuple[str, ...]
    """Axes of the grid, beyond placement, detector and seed."""
    placements: dict[str, tuple[Pose, ...]]
    """x, y, z, roll, pitch, yaw of every mount, by the placement's name."""
    lidars: dict[str, tuple[LidarModel, ...]] = Field({})
    """The LiDAR model of every mount, by the placement's name; none where an axis varies it."""
    classes: Annotated[tuple[str, ...], Field(min_length=1)]
    """Object classes, in the order of the configuration."""
    anchors: tuple[Anchor, ...] = ()
    """Anchors of classes that the detector's preset does not define."""
    colours: dict[str, str] = Field({})
    """Colours of classes in the configuration."""
    roi: Roi
    """The region of interest."""
    frames: Frames
    """Number of frames of each split."""
    cautions: tuple[str, ...] = ()
    """Warnings about its rigs."""
    promote: tuple[Rung, ...] = ()
    """What each rung ranked by, kept and set."""
    evaluator: str = "specialist"
    """What evaluates a placement, unless `evaluator` is an axis; `judge` in older files."""
    detections: dict[str, tuple[str, ...]] = Field({})
    """Files of detections from elsewhere by placement, which `lidarplace evaluate` read; none of a
    sweep."""
    tracking_uri: str | None = None
    """MLflow's tracking URI, without passwords."""
    cores: CountFromOne | None = None
    """Number of tasks that could run at once; null if no task ran."""
    seconds: Annotated[FiniteFloat, Field(ge=0)] | None = None
    """Duration of the last command."""
    versions: dict[str, str] = Field({})
    """Versions of Python and of the libraries."""
    pictured: dict[str, str | int | float | bool | None] = Field({})
    """Setting, by axis, of the maps, frames, clouds and vehicle shown."""
    vehicle: Boxes | None = None
    """Boxes of the vehicle, lowest and highest corner; null: a sedan."""
    vehicle_mesh: Triangles | None = None
    """Its mesh, if it has one, in so few triangles that it can be drawn."""
    site: Surroundings | None = None
    """Buildings and lanes around a site, whose `vehicle` are keep-outs; null: a vehicle."""

    @model_validator(mode="before")
    @classmethod
    def _with_current_keys(cls, content: Any) -> Any:
        """Read the names of keys and axes that older versions wrote."""
        if not isinstance(content, dict):
            return content
        content = with_current_keys(content)
        if isinstance(axes := content.get("axes"), list):
            content["axes"] = [current_key(str(axis)) for axis in axes]
        if isinstance(settings := content.get("pictured"), dict):
            content["pictured"] = with_current_keys(settings)
        return content

    @cached_property
    def body(self) -> Vehicle | None:
        """Vehicle, or poles, that pictures show; None for a sedan, and of older files."""
        if self.vehicle is None:
            return None
        return drawn_vehicle(self.vehicle, self.vehicle_mesh, self.site)

    @property
    def rigs(self) -> dict[str, tuple[Mount, ...]]:
        """Mounts by the placement's name."""
        return {name: tuple(Mount(*m) for m in mounts) for name, mounts in self.placements.items()}
