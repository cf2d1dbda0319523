"""The rigs of a sweep as a file that the studio opens."""

import math
from dataclasses import asdict

import yaml

from lidarplace.configuration.correction import read_correction
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.rig_files.own import DIGITS, as_written
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Mount
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.grid import Sweep
from sweeps.configuration.sweep import Point

FILE = "rigs.yaml"


def rigs_yaml(sweep: Sweep) -> str:
    """Its placements, their LiDARs, the vehicle and its requirements.

    Own placements are in the words of the configuration, those of a recorded rig by coordinates.
    Where an axis varies LiDARs or vehicle, they are those of the first point.
    """
    own = dict(sweep.source.get("placements", {}))
    for name, settings in sweep.common.placements.items():
        if settings.recorded:
            own[name] = _of_log(sweep.points[0].point, settings.recorded)
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
    return {"mounts": [_pose(mount) for mount in PAPER_PLACEMENTS[name].mounts]}


def _pose(mount: Mount) -> dict[str, object]:
    return {key: value for key, value in asdict(mount).items() if value or key == "z"}


def _of_log(point: Point, names: tuple[str, ...]) -> dict[str, object]:
    """LiDARs of a recorded rig with their models, corrected as those of the sweep."""
    assert isinstance(point.scene, LogScene)  # as the rig was built
    rig, correction = point.scene.rig.subset(names), point.lidar.correction
    known = () if correction is None else read_correction(correction).lidars
    mounts = []
    for name, mount, lidar in zip(
        rig.names, rig.placement.mounts, rig.placement.lidars, strict=True
    ):
        model = _model(lidar)
        if correction is not None:
            model |= {"correction": correction, **({"unit": name} if name in known else {})}
        mounts.append({"name": name, **_pose(mount), "lidar": model})
    return {"mounts": mounts}


def _model(lidar: Lidar) -> dict[str, object]:
    """A LiDAR whose beams turn, in the words of a configuration."""
    settings = SensorSettings(
        elevations_deg=tuple(round(math.degrees(e), DIGITS) for e in lidar.elevations),
        azimuth_steps=lidar.azimuth_steps,
        azimuth_deg=tuple(round(math.degrees(end), DIGITS) for end in lidar.azimuth),
        range=lidar.range,
        range_10=lidar.range_10,
        range_80=lidar.range_80,
        min_range=lidar.min_range,
        range_noise=lidar.range_noise,
        drop_off=lidar.drop_off,
        wavelength_nm=round(1e9 * lidar.wavelength, DIGITS),
        window=lidar.window,
        offsets_m=lidar.offsets,
        size_mm=lidar.size and tuple(round(1000 * side, DIGITS) for side in lidar.size),
    )
    return settings.model_dump(mode="json", exclude_defaults=True)
