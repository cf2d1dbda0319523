"""Cautions about rigs, a sentence for each kind."""

import math
from collections.abc import Mapping, Sequence

from lidarplace import Placement
from lidarplace.base.roi import Roi
from lidarplace.clouds.own_body import body_parts, sedan
from lidarplace.clouds.raycast import cast
from lidarplace.clouds.shade import ends_of
from lidarplace.clouds.shapes import BODY
from lidarplace.coverage import count_covered
from lidarplace.mounting.body_share import AZIMUTH_STEPS
from lidarplace.mounting.housing import NO_HOUSINGS
from lidarplace.mounting.limits import Limits, MountedSensors, check
from lidarplace.mounting.random_rigs import outside
from lidarplace.mounting.ring_overlap import Interleaving
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.scan_timing import STILL_WORLD
from sweeps.plan.trial import Plan, Trial, with_detector
from sweeps.stages.collect import CollectStage
from tracking.labels import digits

MOST_NAMED = 8
"""Of the rigs of a kind of caution."""

MOST_PAIRS = 1
"""Of LiDARs of a rig that look into each other."""

LEAST_COVERED = 0.01
"""Share of the ROI's voxels; a level LiDAR of 16 beams on the roof covers 30 % in front."""

MOST_STOPPED = 0.25
"""Share of a LiDAR's rays; of the paper's at most 3 % meet the vehicle, as clouds have it."""


def rig_cautions(plan: Plan) -> list[str]:
    """Warn of rings that coincide, LiDARs that see each other or little, and unfamiliar rigs.

    A sentence for each kind, which names the rigs."""
    by_rig: dict[str, list[Trial]] = {}
    for trial in plan.trials:
        by_rig.setdefault(trial.grid_point.point.placement, []).append(trial)
    interleavings, vehicles, low_cover, stopped, unfamiliar_rigs = {}, {}, {}, {}, {}
    for name, trials in by_rig.items():
        placement, vehicle = trials[0].surrogates.stage.placement, trials[0].grid_point.vehicle
        interleavings[name] = next(filter(None, (trial.interleaving for trial in trials)), None)
        vehicles[name] = placement, sedan() if vehicle is None else vehicle
        low_cover[name] = _low_cover(placement, trials[0].pog.stage.roi)
        stopped[name] = _stopped_rays(placement, vehicle)
        unfamiliar_rigs[name] = _beyond_training(trials)
    return [
        *coinciding(interleavings),
        *facing(vehicles),
        *_in_rigs(f"LiDARs cover less than {100 * LEAST_COVERED:g} % of the ROI", low_cover),
        *_in_rigs(
            f"The vehicle stops more than {100 * MOST_STOPPED:g} % of the rays of LiDARs", stopped
        ),
        *unfamiliar(unfamiliar_rigs),
        *[STILL_WORLD] * any(trial.grid_point.rig.takes_time for trial in plan.trials),
    ]


def _in_rigs(fact: str, details: Mapping[str, str | None]) -> list[str]:
    """Name the rigs of which a fact holds, those with details; [] if there are none."""
    named = [f"{name} ({detail})" for name, detail in details.items() if detail]
    if not named:
        return []
    more = len(named) - MOST_NAMED
    rigs = ", ".join(named[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
    return [f"{fact} in {len(named)} rig{'s' * (len(named) > 1)}: {rigs}."]


def _low_cover(placement: Placement, roi: Roi) -> str:
    """Name the LiDARs that cover less than `LEAST_COVERED` of the ROI, with their percentage."""
    shares = {}
    for number, mount in enumerate(placement.mounts, start=1):
        alone = Placement(placement.name, (mount,), placement.lidars[number - 1])
        shares[number] = count_covered(alone, roi, "cone") / math.prod(roi.shape)
    return _percentages({n: share for n, share in shares.items() if share < LEAST_COVERED})


def _stopped_rays(placement: Placement, vehicle: Vehicle | None) -> str:
    """Name the LiDARs of which the vehicle stops many rays, with the percentage of their rays."""
    shares = {}
    for number, mount in enumerate(placement.mounts, start=1):
        lidar = placement.lidars[number - 1]
        few = lidar.thinned(min(1.0, AZIMUTH_STEPS / lidar.azimuth_steps))
        ends = ends_of(mount, few, NO_HOUSINGS, vehicle)
        returns = cast(mount, few, body_parts(vehicle), ends=ends)
        shares[number] = float((returns.target == BODY).mean())
    return _percentages({n: share for n, share in shares.items() if share > MOST_STOPPED})


def _percentages(shares: Mapping[int, float]) -> str:
    rounded = {number: float(f"{100 * share:.2g}") for number, share in shares.items()}
    return ", ".join(f"LiDAR {number}: {share:g} %" for number, share in rounded.items())


def facing(rigs: Mapping[str, tuple[Placement, Vehicle]]) -> list[str]:
    """Warn of LiDARs that look into each other, in rigs on their vehicles; [] if none do."""
    pairs = {}
    for name, (placement, vehicle) in rigs.items():
        sensors = MountedSensors(placement.mounts, placement.lidars, dead=placement.dead)
        violations = check(sensors, Limits(facing=0), vehicle)
        numbers = [f"{i + 1} and {j + 1}" for i, j in (each.lidars for each in violations)]
        more = len(numbers) - MOST_PAIRS
        pairs[name] = ", ".join(numbers[:MOST_PAIRS]) + (f", {more} pairs more" * (more > 0))
    why = "Their light can cause false or missing returns: raise, tilt or shield one."
    return [f"{line} {why}" for line in _in_rigs("LiDARs look into each other", pairs)]


def coinciding(interleavings: Mapping[str, Interleaving | None]) -> list[str]:
    """Warn of rings that coincide, most first; with pitches that separate the first rig's."""
    rings = {name: pitches for name, pitches in interleavings.items() if pitches}
    worst = sorted(rings, key=lambda name: -rings[name].before)
    shares = {name: f"{100 * rings[name].before:.0f} %" for name in worst}
    lines = _in_rigs("Rings of LiDARs coincide", shares)
    if lines:
        first = rings[worst[0]]
        pitches = ", ".join(digits(math.degrees(pitch), "+.2f") for pitch in first.pitches)
        share = f"{100 * first.after:.0f} %"
        lines[0] += f" With pitches of {pitches} degrees more it is {share} in {worst[0]}."
    return lines


def unfamiliar(beyond: Mapping[str, str | None]) -> list[str]:
    """Warn of rigs outside of those that the generalist was trained on, by how much each is."""
    return _in_rigs("Mounts are beyond those that the generalist was trained on", beyond)


def _beyond_training(trials: Sequence[Trial]) -> str | None:
    for trial in with_detector(trials):
        training = trial.learns
        if training.stage.name != "pretrain" or not trial.collect_test:
            continue
        rigs = [t.stage.placement for t in training.inputs if isinstance(t.stage, CollectStage)]
        stage = trial.collect_test[0].stage
        if not isinstance(stage, CollectStage):
            continue
        if (beyond := outside(stage.placement, rigs)) is not None:
            return beyond
    return None
