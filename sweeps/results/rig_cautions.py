"""Cautions about the rigs of a sweep, a plain sentence each."""

import math
from collections.abc import Sequence

from lidarplace import Placement
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
from sweeps.plan.trial import Plan, Trial, with_detector
from sweeps.stages.collect import CollectStage
from tracking.labels import digits

MOST_NAMED = 8
"""Of rigs whose rings coincide, those with the most; of others the first."""

MOST_PAIRS = 3
"""Of LiDARs of a rig that look into each other."""

LEAST_COVERED = 0.01
"""Share of the ROI's voxels; a level LiDAR of 16 beams on the roof covers 30 % in front."""

MOST_STOPPED = 0.25
"""Share of a LiDAR's rays; of the paper's at most 3 % meet the vehicle, as clouds have it."""


def rig_cautions(plan: Plan) -> list[str]:
    """List coinciding rings, LiDARs that see each other or little, rigs new to the generalist."""
    by_rig: dict[str, list[Trial]] = {}
    for trial in plan.trials:
        by_rig.setdefault(trial.grid_point.point.placement, []).append(trial)
    coincide = {
        name: interleaving
        for name, trials in by_rig.items()
        if (interleaving := next(filter(None, (trial.interleaving for trial in trials)), None))
    }
    worst = sorted(coincide, key=lambda name: -coincide[name].before)
    named = [name for name in coincide if name in worst[:MOST_NAMED]]
    sentences = [coinciding(name, coincide[name]) for name in named]
    more = len(coincide) - len(named)
    if more:
        least = 100 * coincide[worst[MOST_NAMED]].before
        sentences.append(f"So do rings of {more} rigs more, of each at most {least:.0f} %.")
    blinded = []
    for name, trials in by_rig.items():
        placement, vehicle = trials[0].surrogates.stage.placement, trials[0].grid_point.vehicle
        blinded += facing(placement, sedan() if vehicle is None else vehicle, name)
    sentences += blinded[:MOST_NAMED]
    if len(blinded) > MOST_NAMED:
        sentences.append(f"So do LiDARs of {len(blinded) - MOST_NAMED} rigs more.")
    for name, trials in by_rig.items():
        sentences += [*_wasted(name, trials[0]), *filter(None, [_outside(name, trials)])]
    return sentences


def _wasted(name: str, trial: Trial) -> list[str]:
    """Name the LiDARs that see next to nothing of the ROI, or mostly the vehicle itself."""
    placement, roi = trial.surrogates.stage.placement, trial.pog.stage.roi
    body, sentences = trial.grid_point.vehicle, []
    for number, (mount, lidar) in enumerate(
        zip(placement.mounts, placement.lidars, strict=True), start=1
    ):
        alone = Placement(name, (mount,), lidar)
        covered = count_covered(alone, roi, "cone") / math.prod(roi.shape)
        if covered < LEAST_COVERED:
            sentences.append(f"{name}: LiDAR {number} covers {100 * covered:.2g} % of the ROI.")
        few = lidar.thinned(min(1.0, AZIMUTH_STEPS / lidar.azimuth_steps))
        ends = ends_of(mount, few, NO_HOUSINGS, body)
        met = cast(mount, few, body_parts(body), ends=ends)
        stopped = float((met.target == BODY).mean())
        if stopped > MOST_STOPPED:
            fired = f"{100 * stopped:.0f} % of what LiDAR {number} fires"
            sentences.append(f"{name}: {fired} meets the vehicle.")
    return sentences


def facing(placement: Placement, vehicle: Vehicle, name: str) -> list[str]:
    """Warn that LiDARs of a rig look into each other; [] if none do."""
    sensors = MountedSensors(placement.mounts, placement.lidars, dead=placement.dead)
    violations = check(sensors, Limits(facing=0), vehicle)
    pairs = [f"{i + 1} and {j + 1}" for i, j in (violation.lidars for violation in violations)]
    more = f" and {len(pairs) - MOST_PAIRS} pairs more" if len(pairs) > MOST_PAIRS else ""
    sentence = (
        f"{name}: LiDARs {', '.join(pairs[:MOST_PAIRS])}{more} look into each other, which blinds "
        "or deceives those that are not made for it; raise, tilt or shield one."
    )
    return [sentence] if pairs else []


def coinciding(name: str, interleaving: Interleaving) -> str:
    """Warn that the rings of a rig coincide, and name pitches with which they would not."""
    pitches = ", ".join(digits(math.degrees(pitch), "+.2f") for pitch in interleaving.pitches)
    return (
        f"{name}: {100 * interleaving.before:.0f} % of its rings coincide with those of another of "
        f"its LiDARs; with pitches of {pitches} degrees more, {100 * interleaving.after:.0f} % do."
    )


def _outside(name: str, trials: Sequence[Trial]) -> str | None:
    for trial in with_detector(trials):
        training = trial.learns
        if training.stage.name != "pretrain" or not trial.collect_test:
            continue
        rigs = [t.stage.placement for t in training.inputs if isinstance(t.stage, CollectStage)]
        stage = trial.collect_test[0].stage
        if not isinstance(stage, CollectStage):
            continue
        if (beyond := outside(stage.placement, rigs)) is not None:
            return beyond_what_is_seen(name, beyond)
    return None


def beyond_what_is_seen(name: str, beyond: str) -> str:
    """Warn that a rig is outside of those that the generalist has seen, and by how much."""
    return f"{name} is outside of the rigs that the generalist has seen: {beyond}."
