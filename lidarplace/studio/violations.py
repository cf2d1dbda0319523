"""Which constraints a rig does not keep, where and by how much."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.clouds.blind_lidars import blind_lidars, why_blind
from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.common_view import common_view, weakest
from lidarplace.mounting.facing import facing_pairs
from lidarplace.mounting.housing import housings_of, without
from lidarplace.mounting.vehicle import depth_in, depth_in_body
from lidarplace.mounting.zone import distance
from lidarplace.requirements.judge import Outcome, judge
from lidarplace.requirements.layout import Laid
from lidarplace.requirements.requirement import AS_BUILT
from lidarplace.rigs.catalogue.datasheet import datasheet
from lidarplace.rigs.placement import Placement
from lidarplace.studio.rig import Rig
from lidarplace.studio.rigs_file import RigsFile

ROUNDING = 1e-9
"""0.6 - 0.4 is not quite 0.2."""
MICROMETRE = 1e-6
"""What is on the edge of a zone is in it."""


@dataclass(frozen=True)
class Violation:
    """A constraint that is not kept: zone, body, keep_out, distance, body_share, common_view,
    facing, price, power, blind or requirement.

    `lidars` are the numbers of those concerned, none if it is the rig; `excess` is by how much, in
    metres, a share, money, watts, or what a requirement lacks in its own measure; NaN where it is
    not known."""

    constraint: str
    lidars: tuple[int, ...]
    excess: float
    text: str


def prices_of(rig: Rig, file: RigsFile) -> list[float]:
    """Of LiDARs, disabled or not, cameras and radars, in the file's currency; NaN if unknown."""
    prices = file.settings.prices
    own = [math.nan if one.price is None else one.price for one in rig.settings_of_sensors]
    return [prices.get(name or "", math.nan) for name in _models(rig, file)] + own


def powers_of(rig: Rig, file: RigsFile) -> list[float]:
    """The same in watts, by their data sheets."""
    sheets = [None if name is None else datasheet(name).power_w for name in _models(rig, file)]
    sheets += [own.power for own in rig.settings_of_sensors]
    return [math.nan if watts is None else watts for watts in sheets]


def _models(rig: Rig, file: RigsFile) -> list[str | None]:
    """Names of the LiDARs in the catalogue."""
    default = file.settings.lidar.name
    return [lidar.model if "lidar" in lidar.written else default for lidar in rig.lidars]


def violations(rig: Rig, file: RigsFile) -> tuple[Violation, ...]:
    """All that the rig does not keep of what the file says."""
    parts = (_outside, _inside, _close, _blocked, _paired, totals_above)
    return tuple(one for part in parts for one in part(rig, file))


def totals_above(rig: Rig, file: RigsFile) -> Iterator[Violation]:
    """The sums over LiDARs that are more than allowed, or not known."""
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
            known = zip([*_models(rig, file), *(s.name for s in rig.sensors)], values, strict=True)
            strange = {model or "a LiDAR without a name" for model, one in known if one != one}
            text = f"{name}: of {', '.join(sorted(strange))} it is not known"
        yield Violation(name, (), total - limit, text)


def _outside(rig: Rig, file: RigsFile) -> Iterator[Violation]:
    for number, mount in enumerate(rig.mounts) if file.zones else ():
        away, name = min((distance(z, mount.x, mount.y, mount.z), z.name) for z in file.zones)
        if away > MICROMETRE:
            text = f"LiDAR {number}: {away:.3g} m outside of the nearest zone, {name}"
            yield Violation("zone", (number,), away, text)


def _inside(rig: Rig, file: RigsFile) -> Iterator[Violation]:
    places = np.array([mount.position for mount in rig.mounts]).reshape(-1, 3)
    for constraint, depths, what in (
        ("body", depth_in_body(file.vehicle, places), "the vehicle's body"),
        ("keep_out", depth_in(file.keep_out, places), "what is kept out"),
    ):
        for number, depth in enumerate(depths.tolist()):
            if depth > 0:
                text = f"LiDAR {number}: {depth:.3g} m inside of {what}"
                yield Violation(constraint, (number,), depth, text)


def _close(rig: Rig, file: RigsFile) -> Iterator[Violation]:
    least = file.settings.constraints.distance
    for i, j in combinations(range(len(rig.mounts)), 2):
        apart = math.dist(rig.mounts[i].position, rig.mounts[j].position)
        if apart < least - ROUNDING or apart == 0:
            how = (
                f"{apart:.3g} m apart, {least - apart:.3g} m too close" if apart else "in one place"
            )
            yield Violation("distance", (i, j), least - apart, f"LiDARs {i} and {j}: {how}")


def _blocked(rig: Rig, file: RigsFile) -> Iterator[Violation]:
    limit = file.settings.constraints.body_share
    if limit is None:
        return
    models = rig.models(file.lidar)
    housings = housings_of(rig.mounts, models)
    for number, (mount, lidar) in enumerate(zip(rig.mounts, models, strict=True)):
        share = body_share(mount, lidar, file.body, others=without(housings, number))
        if share > limit + ROUNDING:
            met = f"{100 * share:.3g} % of its rays meet the vehicle, allowed are {100 * limit:g} %"
            yield Violation("body_share", (number,), share - limit, f"LiDAR {number}: {met}")


def _whole(rig: Rig, file: RigsFile) -> Placement | None:
    """All LiDARs, dead or not; None without any, or for two in one place (see `_close`)."""
    try:
        return Placement(rig.name, rig.mounts, lidar=rig.models(file.lidar))
    except ValueError:
        return None


def _paired(rig: Rig, file: RigsFile) -> Iterator[Violation]:
    limits = file.settings.constraints
    asked_for = limits.common_view is not None or limits.facing is not None
    whole = _whole(rig, file) if asked_for else None
    if whole is not None and limits.common_view is not None:
        asked = limits.common_view.asked()
        share, pair = weakest(common_view(whole, file.body, asked, rig.sensors), asked)
        if pair is not None and share < asked.share - ROUNDING:
            names = [f"LiDAR {n}" for n in range(len(rig.lidars))]
            names += [sensor.name for sensor in rig.sensors]
            between = " and ".join(names[n] if n < len(names) else "none" for n in pair)
            text = (
                f"{between}: {100 * share:.3g} % of the smaller field of view in common, expected "
                f"at least {100 * asked.share:g} %"
            )
            lidars = tuple(n for n in pair if n < len(rig.lidars))
            yield Violation("common_view", lidars, asked.share - share, text)
    if whole is not None and limits.facing is not None:
        pairs = facing_pairs(whole, file.body)
        for pair in pairs if len(pairs) > limits.facing else ():
            text = f"LiDARs {pair[0]} and {pair[1]}: look into each other"
            yield Violation("facing", pair, float(len(pairs) - limits.facing), text)


def blind(rig: Rig, file: RigsFile, roi: Roi) -> list[Violation]:
    """The LiDARs that see nothing of the ROI, dead or not, unless the file allows them."""
    whole = None if file.settings.allow_blind_lidars else _whole(rig, file)
    if whole is None:
        return []
    found = blind_lidars(whole, roi, file.carrier)
    whys = [(n, "; ".join(why_blind(whole, roi, n, first=0))) for n in found]
    return [Violation("blind", (n,), math.nan, f"LiDAR {n}: {why}") for n, why in whys]


def check_sweepable(rig: Rig, file: RigsFile, roi: Roi) -> None:
    """Raise ValueError if a sweep would refuse the rig: a LiDAR inside of the body, or blind."""
    for one in (*_inside(rig, file), *blind(rig, file, roi)):
        raise InputError(one.text, place=f"rig {rig.name!r}")


def unmet(outcomes: Sequence[Outcome]) -> Iterator[Violation]:
    """The requirements that are not met, where and by how much."""
    for outcome in outcomes:
        wanted, worst = outcome.requirement, outcome.worst
        lacks = wanted.least - worst.value
        case = "" if worst.case == AS_BUILT else f", {worst.case}"
        place = "" if math.isnan(worst.x) else f"; worst at x {worst.x:.2f}, y {worst.y:.2f}"
        text = (
            f"{wanted.name}: {worst.value:.3g} {wanted.measured}, {lacks:.3g} short of "
            f"{wanted.least:g}{case}{place}"
        )
        if not outcome.met:
            yield Violation("requirement", (), lacks, text)


def unasked(laid: Sequence[Laid]) -> Iterator[Violation]:
    """All requirements, of a rig without a LiDAR that works."""
    for wanted in (own.requirement for own in laid):
        yield Violation("requirement", (), wanted.least, f"{wanted.name}: no LiDAR works")


def unknown(rig: Rig, file: RigsFile) -> dict[str, Violation]:
    """By name the requirements that cannot be asked of a LiDAR that works, and of the first why."""
    found: dict[str, Violation] = {}
    for own in file.settings.requirements:
        for number, lidar in enumerate(rig.models(file.lidar)):
            if (
                rig.lidars[number].enabled
                and own.name not in found
                and (reason := own.not_of(lidar))
            ):
                text = f"{own.name}: {reason[0]}: LiDAR {number}: {reason[1]}"
                found[own.name] = Violation("requirement", (number,), math.nan, text)
    return found


def judged(rig: Rig, file: RigsFile, laid: Sequence[Laid]) -> list[Outcome]:
    """What becomes of those of the requirements that can be asked of the LiDARs that work.
    Nothing without such a LiDAR. Raises ValueError if two are in one place."""
    placement = rig.placement(file.lidar)
    if placement is None:
        return []
    left_out = unknown(rig, file)
    asked = [own for own in laid if own.requirement.name not in left_out]
    return judge(asked, placement, file.body, rig.sensors)
