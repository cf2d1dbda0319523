"""Rigs of a sweep for people: a file that the studio opens, a page, and their LiDAR models."""

import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import yaml

from lidarplace.configuration.correction import read_correction
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.rig_files.mounts_yaml import DIGITS, as_written
from lidarplace.rigs.catalogue.datasheet import datasheet
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Mount, Placement
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.grid import Sweep
from sweeps.configuration.point import Point
from tracking.figures.kit.vehicle_lines import words_of_views
from tracking.pages.html_page import SECTIONS_ALONE, write_page
from tracking.pages.section import Section
from tracking.report.decision.rigs import rig_views, viewed_rig
from tracking.run_folders.sweep_json import LidarModel

FILE = "rigs.yaml"

_ALIKE = (
    *("azimuth_steps", "range", "range_10", "range_80", "min_range", "range_noise"),
    *("drop_off", "window"),
)
"""Attributes that a LiDAR and its settings have under one name and in one unit."""

MOST_DRAWN = 40
"""Most rigs of a page; more are not looked at."""


def lidar_models(sweep: Sweep) -> dict[str, tuple[LidarModel, ...]]:
    """Describe the model of every mount, by the placement's name; {} where an axis varies it."""
    if any(axis.partition(".")[0] == "lidar" for axis in sweep.axes):
        return {}
    points = {one.point.placement: one for one in sweep.points}
    return {name: _models(sweep, one.point, one.rig) for name, one in points.items()}


def _models(sweep: Sweep, point: Point, rig: Placement) -> tuple[LidarModel, ...]:
    settings = sweep.common.placements.get(point.placement)
    if settings is None:
        names = [point.lidar.name] * len(rig.mounts)
    elif settings.recorded:  # by their beams alone
        names = [None] * len(rig.mounts)
    else:
        names = [(mount.lidar or point.lidar).name for mount in settings.mounts]
    models = []
    for name, lidar in zip(names, rig.lidars, strict=True):
        low, high = np.degrees([min(lidar.elevations), max(lidar.elevations)]).round(9)
        models.append(
            LidarModel(
                name=name,
                price_usd=datasheet(name).price_usd if name else None,
                beams=lidar.beams,
                elevation_deg=(low, high),
                azimuth_steps=lidar.azimuth_steps,
            )
        )
    return tuple(models)


def write_rigs_page(sweep: Sweep, cautions: list[str]) -> Path:
    """Draw the first `MOST_DRAWN` rigs from above and from the side, below the cautions about them.

    Returns the page, which is in the sweep's run folder."""
    rigs = {one.point.placement: one.rig for one in sweep.points}
    models = lidar_models(sweep)
    drawn = list(rigs)[:MOST_DRAWN]
    vehicle = sweep.points[0].poles or sweep.points[0].vehicle
    section = Section(
        "Rigs",
        notes=[words_of_views(vehicle), *cautions],
        figures=rig_views(
            [viewed_rig(name, rigs[name].mounts, models.get(name, ())) for name in drawn], vehicle
        ),
    )
    if len(drawn) < len(rigs):
        section.notes.insert(1, f"The first {len(drawn)} of {len(rigs)}.")
    folder = sweep.common.output / sweep.common.name
    folder.mkdir(parents=True, exist_ok=True)
    return write_page(folder / "rigs.html", SECTIONS_ALONE, [section], name=sweep.common.name)


def rigs_yaml(sweep: Sweep) -> str:
    """Write the placements of a sweep, their LiDARs, vehicle or site, and requirements as YAML.

    Own placements are in the words of the configuration, those of a recorded rig by coordinates.
    Where an axis varies LiDARs or vehicle, they are those of the first point."""
    by_name = dict(sweep.source.get("placements", {}))
    for name, settings in sweep.common.placements.items():
        if settings.recorded:
            by_name[name] = _of_log(sweep.points[0].point, settings.recorded)
    names = dict.fromkeys(point.point.placement for point in sweep.points)
    for name in names.keys() - by_name.keys():
        by_name[name] = {"mounts": [_pose(mount) for mount in PAPER_PLACEMENTS[name].mounts]}
    sensor = sweep.points[0].point.lidar.model_dump(
        mode="json", include={*SensorSettings.model_fields}, exclude_unset=True
    )
    point = sweep.points[0].point
    keys = {"vehicle"} if point.site is None else {"vehicle", "site", "scene"}
    carrier = point.model_dump(mode="json", include=keys, exclude_unset=True)
    content = {
        **carrier,
        **{key: sweep.source[key] for key in ("requirements",) if key in sweep.source},
        "lidar": as_written(SensorSettings.model_validate(sensor)),
        "placements": {name: by_name[name] for name in names},
    }
    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100))


def _pose(mount: Mount) -> dict[str, object]:
    return {key: value for key, value in asdict(mount).items() if value or key == "z"}


def _of_log(point: Point, names: tuple[str, ...]) -> dict[str, object]:
    """Describe the LiDARs of a recorded rig with their models, corrected as those of the sweep."""
    assert isinstance(point.scene, LogScene)  # as the rig was built
    rig, correction = point.scene.rig.subset(names), point.lidar.correction
    units = () if correction is None else read_correction(correction).lidars
    mounts = []
    for name, mount, lidar in zip(
        rig.names, rig.placement.mounts, rig.placement.lidars, strict=True
    ):
        model = _model(lidar)
        if correction is not None:
            model |= {"correction": correction, **({"unit": name} if name in units else {})}
        model |= {key: getattr(lidar, key) for key, _ in point.lidar.losses}
        mounts.append({"name": name, **_pose(mount), "lidar": model})
    return {"mounts": mounts}


def _model(lidar: Lidar) -> dict[str, object]:
    """Describe a LiDAR whose beams turn, in the words of a configuration."""
    settings = SensorSettings(
        **{name: getattr(lidar, name) for name in _ALIKE},
        elevations_deg=tuple(round(math.degrees(e), DIGITS) for e in lidar.elevations),
        azimuth_deg=tuple(round(math.degrees(end), DIGITS) for end in lidar.azimuth),
        wavelength_nm=round(1e9 * lidar.wavelength, DIGITS),
        offsets_m=lidar.offsets,
        azimuth_offsets_deg=lidar.azimuth_offsets
        and tuple(round(math.degrees(offset), DIGITS) for offset in lidar.azimuth_offsets),
        size_mm=lidar.size and tuple(round(1000 * side, DIGITS) for side in lidar.size),
    )
    return settings.model_dump(mode="json", exclude_defaults=True)
