"""The rigs of a sweep as a file that the studio opens."""

from dataclasses import asdict

import yaml

from lidarplace.configuration.sensor import SensorSettings
from lidarplace.rig_files.own import as_written
from lidarplace.rigs.placement import PAPER_PLACEMENTS
from sweeps.configuration.grid import Sweep

FILE = "rigs.yaml"


def rigs_yaml(sweep: Sweep) -> str:
    """Its placements, their LiDARs, the vehicle and its requirements.

    Own placements are in the words of the configuration. Where an axis varies LiDARs or vehicle,
    they are those of the first point.
    """
    own = sweep.source.get("placements", {})
    names = dict.fromkeys(point.point.placement for point in sweep.points)
    sensor = sweep.points[0].point.lidar.model_dump(
        mode="json", include={*SensorSettings.model_fields}, exclude_unset=True
    )
    vehicle = sweep.points[0].point.model_dump(mode="json", include={"vehicle"}, exclude_unset=True)
    required = {key: own for key, own in sweep.source.items() if key == "requirements"}
    content = {
        **vehicle,
        **required,
        "lidar": as_written(SensorSettings.model_validate(sensor)),
        "placements": {name: own[name] if name in own else _of_paper(name) for name in names},
    }
    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100))


def _of_paper(name: str) -> dict[str, object]:
    mounts = [asdict(mount).items() for mount in PAPER_PLACEMENTS[name].mounts]
    return {
        "mounts": [{key: value for key, value in mount if value or key == "z"} for mount in mounts]
    }
