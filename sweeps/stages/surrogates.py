"""The stage that computes the surrogates of a POG."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import pandas as pd

from lidarplace import Placement, Roi, evaluate_classes
from lidarplace.coverage import Method
from lidarplace.pog.surrogates.evaluate import linear_share
from lidarplace.pog.surrogates.table import SURROGATES, to_ask_for
from sweeps.stages.pog import Pog, grids_of
from sweeps.stages.stage import OCCLUSION_BYTES, VoxelStage


@dataclass(frozen=True, eq=False)
class Scores:
    """Surrogates of one rig: class, surrogate, value, method, seconds.

    Rows of `expected_ig` have a `linear_share`, too."""

    table: pd.DataFrame


@dataclass(frozen=True)
class SurrogatesStage(VoxelStage[Scores]):
    """Compute the surrogates `names` of a rig on the POG, for every class.

    `roi`: that of the POG."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    names: Annotated[tuple[str, ...], "surrogate.names"]
    method: Annotated[Method, "surrogate.method"]
    detection_probability: Annotated[float, "surrogate.detection_probability"]
    occlusion: Annotated[bool, "surrogate.occlusion"]
    roi: Roi = field(compare=False)

    name = "surrogates"
    order = 90
    tables: ClassVar = {"table": "surrogates"}
    plugins: ClassVar = {"names": SURROGATES}

    def bytes_per_voxel(self) -> int:
        return 8 + OCCLUSION_BYTES * self.occlusion

    def run(self, pog: Pog) -> Scores:
        grids, rows = grids_of(pog), []
        if self.names:
            results = evaluate_classes(
                grids,
                self.placement,
                method=self.method,
                surrogates=to_ask_for(self.names),
                detection_probability=self.detection_probability,
                occlusion=self.occlusion,
            )
            companions = (n for n, spec in SURROGATES.own.items() if spec.beside in self.names)
            reported = (*self.names, *companions)
            rows = [
                (object_class, name, result[name], self.method, result.seconds)
                for object_class, result in results.items()
                for name in reported
            ]
        columns = ["class", "surrogate", "value", "method", "seconds"]
        table = pd.DataFrame(rows, columns=columns).astype({"value": float, "seconds": float})
        if "expected_ig" in self.names:
            shares = linear_share(grids, self.placement, self.detection_probability)
            share = table["class"].map(shares)
            table["linear_share"] = share.where(table["surrogate"] == "expected_ig")
        return Scores(table)
