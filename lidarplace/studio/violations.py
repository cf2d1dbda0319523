"""Limits and requirements that a rig of the studio violates, where and by how much."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.clouds.blind_lidars import blind_lidars, why_blind
from lidarplace.mounting.counts import CountBound
from lidarplace.mounting.limits import (
    MICROMETRE,
    ROUNDING,
    Limits,
    MountedSensors,
    Violation,
    check,
)
from lidarplace.mounting.zone import distance
from lidarplace.requirements.check_requirements import RequirementResult, check_requirements
from lidarplace.requirements.layout import RequirementLayout
from lidarplace.requirements.requirement import AS_BUILT
from lidarplace.requirements.tables import case_row, verdict
from lidarplace.rigs.catalogue.datasheet import datasheet
from lidarplace.studio.rig import ANGLES, Rig
from lidarplace.studio.rigs_file import RigsFile
from lidarplace.studio.turns import ROUNDING_DEG, allowed_turns, beyond


@dataclass(frozen=True)
class ReportedViolation(Violation):
    """A limit, a total or a requirement that a rig violates, and its description.

    `limit` is also "price", "power", "count", "turn", "blind", "pole" or "requirement"; `lidars` is
    empty if the whole rig violates it; `value` and `excess` are in money, watts, degrees or the
    requirement's measure, too, and NaN where unknown."""

    text: str


def prices_of(rig: Rig, file: RigsFile) -> list[float]:
    """Return the prices of all LiDARs, cameras and radars, in the file's currency; NaN: unknown.

    Those of LiDARs include the mounts of their zones."""
    prices, zones = file.settings.prices, file.settings.zones
    further = [sensor.price for sensor in rig.settings_of_sensors]
    lidars = [
        prices.get(lidar.model, math.nan) + (zones[lidar.zone].price if lidar.zone else 0.0)
        for lidar in _named_lidars(rig, file)
    ]
    return lidars + [math.nan if price is None else price for price in further]


def powers_of(rig: Rig, file: RigsFile) -> list[float]:
    """Return the power of all LiDARs, cameras and radars, watts, by data sheets; NaN: unknown."""
    powers = [None if name is None else datasheet(name).power_w for name in model_names(rig, file)]
    powers += [sensor.power for sensor in rig.settings_of_sensors]
    return [math.nan if watts is None else watts for watts in powers]


def model_names(rig: Rig, file: RigsFile) -> list[str | None]:
    """Return the names of the LiDARs in the catalogue."""
    default = file.settings.lidar.name
    return [lidar.model if "lidar" in lidar.written else default for lidar in rig.lidars]


def violations(rig: Rig, file: RigsFile) -> tuple[ReportedViolation, ...]:
    """Return the limits of mounting, then the totals, that a rig exceeds."""
    misplaced = (*_misplaced(rig, file, file.limits), *_blocked(rig, file))
    return (*misplaced, *_turned_too_far(rig, file), *totals_above(rig, file))


def totals_above(rig: Rig, file: RigsFile) -> Iterator[ReportedViolation]:
    """Yield numbers of LiDARs, price and power that exceed their bounds or are unknown."""
    yield from _miscounted(rig, file)
    limits = file.settings.constraints
    for name, values, limit, unit in (
        ("price", prices_of(rig, file), limits.price, ""),
        ("power", powers_of(rig, file), limits.power, " W"),
    ):
        total = math.fsum(values)
        if limit is None or total <= limit + ROUNDING:
            continue
        text = f"{name} {total:g}{unit}: {total - limit:g}{unit} above {limit:g}{unit}"
        if math.isnan(total):
            sensors = [*model_names(rig, file), *(sensor.name for sensor in rig.sensors)]
            pairs = zip(sensors, values, strict=True)
            unpriced = {sensor or "a LiDAR without a name" for sensor, x in pairs if math.isnan(x)}
            text = f"{name}: of {', '.join(sorted(unpriced))} it is not known"
        yield ReportedViolation(name, (), total, total - limit, text)


class _NamedLidar(NamedTuple):
    zone: str
    model: str


def _named_lidars(rig: Rig, file: RigsFile) -> list[_NamedLidar]:
    """Return the zone and the model of each LiDAR, "" where it has none."""
    lidars = []
    for mount, model in zip(rig.mounts, model_names(rig, file), strict=True):
        at = mount.position
        zones = (zone.name for zone in file.zones if distance(zone, *at) <= MICROMETRE)
        lidars.append(_NamedLidar(next(zones, ""), model or ""))
    return lidars


def _miscounted(rig: Rig, file: RigsFile) -> Iterator[ReportedViolation]:
    """Yield the bounds on numbers of LiDARs that the rig breaks."""
    lidars = _named_lidars(rig, file)
    excluded = [
        CountBound(f"zones.{zone}.models", 0, 0, zone, model)
        for zone, settings in file.settings.zones.items()
        for model in dict.fromkeys(lidar.model for lidar in lidars)
        if settings.models and model not in settings.models
    ]
    for bound in (*file.counts, *excluded):
        unit = bound.model or ("pairs" if bound.size > 1 else "LiDARs")
        number = bound.number(lidars)
        excess = max(bound.low - number, number - bound.high)
        if excess > 0:
            text = f"{bound.key}: {number} {unit}, expected {bound.text}"
            yield ReportedViolation("count", (), number, excess, text)


def _turned_too_far(rig: Rig, file: RigsFile) -> Iterator[ReportedViolation]:
    """Yield the angles that the zones of the LiDARs do not allow."""
    for number, lidar in enumerate(_named_lidars(rig, file)):
        pose = rig.pose(number)
        turns = allowed_turns(file, lidar.zone, lidar.model, pose["y"])
        far = beyond([pose[angle] for angle in ANGLES], turns)
        for angle, excess, (centre, half) in zip(ANGLES, far.tolist(), turns.tolist(), strict=True):
            if abs(excess) > ROUNDING_DEG:
                span = f"{centre:g}°" if half == 0 else f"{centre - half:g}° to {centre + half:g}°"
                text = f"LiDAR {number + 1}: {angle} {pose[angle]:.4g}°, in {lidar.zone} {span}"
                yield ReportedViolation("turn", (number,), pose[angle], abs(excess), text)


def _misplaced(rig: Rig, file: RigsFile, limits: Limits) -> Iterator[ReportedViolation]:
    sensors = MountedSensors(rig.mounts, rig.models(file.lidar), rig.sensors)
    for violation in check(sensors, limits, file.body):
        lidars = tuple(number for number in violation.lidars if number < len(rig.lidars))
        fields = vars(violation) | {"lidars": lidars, "text": _text(violation, rig, file)}
        yield ReportedViolation(**fields)


def _blocked(rig: Rig, file: RigsFile) -> Iterator[ReportedViolation]:
    """Yield the LiDARs of a site that no pole can hold."""
    for number, mount in enumerate(rig.mounts):
        if text := file.blocked(number, mount.position):
            yield ReportedViolation("pole", (number,), math.nan, math.nan, text)


def _text(violation: Violation, rig: Rig, file: RigsFile) -> str:
    """Describe which sensors exceed a limit of mounting, and by how much."""
    value, bound = violation.value, file.limits.bounds[violation.limit]
    names = [f"LiDAR {number + 1}" for number in range(len(rig.lidars))]
    names += [sensor.name for sensor in rig.sensors]
    named = [names[n] if n < len(names) else "none" for n in violation.lidars]
    lidar, pair = named[0], " and ".join(named)
    lidars = pair.replace("and LiDAR", "and").replace("LiDAR", "LiDARs")
    match violation.limit:
        case "zone":
            at = rig.mounts[violation.lidars[0]].position
            _, nearest = min((distance(zone, *at), zone.name) for zone in file.zones)
            return f"{lidar}: {value:.3g} m outside of the nearest zone, {nearest}"
        case "body":
            return f"{lidar}: {value:.3g} m inside of the vehicle's body"
        case "keep_out":
            return f"{lidar}: {value:.3g} m inside of what is kept out"
        case "distance" if value == 0:
            return f"{lidars}: in one place"
        case "distance":
            return f"{lidars}: {value:.3g} m apart, {violation.excess:.3g} m too close"
        case "body_share":
            share = f"{100 * value:.3g} % of its rays meet the vehicle"
            return f"{lidar}: {share}, allowed are {100 * bound:g} %"
        case "common_view":
            share = f"{100 * value:.3g} % of the smaller field of view in common"
            return f"{pair}: {share}, expected at least {100 * bound:g} %"
    return f"{lidars}: look into each other"


def blind(rig: Rig, file: RigsFile, roi: Roi) -> list[ReportedViolation]:
    """Return the LiDARs, enabled or not, that see nothing of the ROI, unless the file allows it."""
    placement = MountedSensors(rig.mounts, rig.models(file.lidar)).placement
    if placement is None or file.settings.allow_blind_lidars:
        return []
    reasons = {
        number: "; ".join(why_blind(placement, roi, number))
        for number in blind_lidars(placement, roi, file.carrier)
    }
    return [
        ReportedViolation("blind", (number,), math.nan, math.nan, f"LiDAR {number + 1}: {reason}")
        for number, reason in reasons.items()
    ]


def check_sweepable(rig: Rig, file: RigsFile, roi: Roi) -> None:
    """Raise ValueError if a sweep would refuse the rig: a LiDAR inside of the body, or blind."""
    solid = Limits(body=file.limits.body, keep_out=file.limits.keep_out)
    misplaced = (*_misplaced(rig, file, solid), *_blocked(rig, file))
    for violation in (*misplaced, *blind(rig, file, roi)):
        raise InputError(violation.text, place=f"rig {rig.name!r}")


def unmet(results: Sequence[RequirementResult]) -> Iterator[ReportedViolation]:
    """Yield the requirements that are not met, where and by how much."""
    for result in results:
        requirement, worst = result.requirement, result.worst
        missing = requirement.least - worst.value
        case = "" if worst.case == AS_BUILT else f", {worst.case}"
        place = "" if math.isnan(worst.x) else f"; worst at x {worst.x:.2f}, y {worst.y:.2f}"
        text = (
            f"{requirement.name}: {worst.value:.3g} {requirement.measured}, {missing:.3g} short of "
            f"{requirement.least:g}{case}{place}"
        )
        if worst.undecided:
            text += f" ({verdict({'for': requirement.share, **case_row(result, worst)})})"
        if not result.met:
            yield ReportedViolation("requirement", (), worst.value, missing, text)


def unmet_without_lidars(layouts: Sequence[RequirementLayout]) -> Iterator[ReportedViolation]:
    """Yield all requirements, none of which a rig without a working LiDAR meets."""
    for requirement in (layout.requirement for layout in layouts):
        text = f"{requirement.name}: no LiDAR works"
        yield ReportedViolation("requirement", (), 0.0, requirement.least, text)


def inapplicable(rig: Rig, file: RigsFile) -> dict[str, ReportedViolation]:
    """Return requirements that do not apply to a working LiDAR, by name, with the first reason."""
    violations: dict[str, ReportedViolation] = {}
    for settings in file.settings.requirements:
        for number, lidar in enumerate(rig.models(file.lidar)):
            reason = settings.not_of(lidar) if rig.lidars[number].enabled else None
            if reason and settings.name not in violations:
                text = f"{settings.name}: {reason[0]}: LiDAR {number + 1}: {reason[1]}"
                violations[settings.name] = ReportedViolation(
                    "requirement", (number,), math.nan, math.nan, text
                )
    return violations


def requirement_results(
    rig: Rig, file: RigsFile, layouts: Sequence[RequirementLayout]
) -> list[RequirementResult]:
    """Check the requirements that apply to the working LiDARs; none without such a LiDAR.

    Raises ValueError if two LiDARs are in one place."""
    placement = rig.placement(file.lidar)
    if placement is None:
        return []
    left_out = inapplicable(rig, file)
    applicable = [layout for layout in layouts if layout.requirement.name not in left_out]
    return check_requirements(applicable, placement, file.hiding, rig.sensors)
