"""The configuration of `lidarplace requirements`: rigs, their vehicle, and what has to be seen."""

from typing import Annotated

from pydantic import Field

from lidarplace.configuration.mounting import KeepOuts
from lidarplace.configuration.placement import PlacementSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import FilePath, Name, Settings, short_for
from lidarplace.configuration.vehicle import OwnVehicle
from lidarplace.requirements.settings import Requirements


class RequirementsFile(Settings):
    """The file as a whole."""

    lidar: Annotated[SensorSettings, short_for("name")] = Field(
        SensorSettings(), description="the LiDARs, unless a mount has its own"
    )
    vehicle: OwnVehicle = Field(None, description="the body of the vehicle; a car by default")
    keep_out: KeepOuts = Field(default={})
    placements: dict[Name, PlacementSettings] = Field(
        default={}, description="own placements by name"
    )
    rigs: tuple[Name, ...] = Field(
        (),
        description="which are asked: own placements, the paper's by name, FILE.yaml with mounts, "
        "run folders of searches; by default all own ones, or else the paper's eight",
    )
    curves: FilePath | None = Field(
        None,
        description="detection curves, a file of lidarplace calibrate; those of the package "
        "if null",
    )
    requirements: Requirements = Field(min_length=1, description="what has to be seen")
