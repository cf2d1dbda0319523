"""The stage that checks requirements."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace import Placement
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.requirement import Requirement
from lidarplace.rigs.further_sensors import MountedSensor
from sweeps.stages.stage import Stage


@dataclass(frozen=True, eq=False)
class RequirementResults:
    """Outcome of each requirement under a rig.

    `table`: columns of `lidarplace.requirements.tables.case_table`. `x`, `y`, `least`: those of
    `lidarplace.requirements.tables.Ground`, metres and the measure of the requirement, by its
    number; `least` as float32."""

    table: pd.DataFrame
    x: Mapping[str, NDArray[np.float64]]
    y: Mapping[str, NDArray[np.float64]]
    least: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class RequirementsStage(Stage[RequirementResults]):
    """Check requirements of a rig and the vehicle that carries it.

    `further`: cameras and radars of the rig."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    vehicle: Annotated[Vehicle, "vehicle", "site"]
    requirements: Annotated[tuple[Requirement, ...], "surrogate.curves"]
    further: Annotated[tuple[MountedSensor, ...], "placement"] = ()

    name = "requirements"
    order = 110
    tables: ClassVar = {"table": "requirements"}

    def run(self) -> RequirementResults:
        from lidarplace.requirements.check_requirements import check_requirements
        from lidarplace.requirements.layout import lay_out
        from lidarplace.requirements.tables import Ground, case_table

        layouts = [lay_out(requirement, self.vehicle) for requirement in self.requirements]
        outcomes = check_requirements(layouts, self.placement, self.vehicle, self.further)
        grounds = {str(number): Ground.of(outcome) for number, outcome in enumerate(outcomes)}
        return RequirementResults(
            case_table(outcomes),
            x={number: ground.x for number, ground in grounds.items()},
            y={number: ground.y for number, ground in grounds.items()},
            least={number: ground.least.astype(np.float32) for number, ground in grounds.items()},
        )
