"""MLflow pages of a sweep and its trials: tags, data, a note, columns."""

import hashlib
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Literal

from lidarplace.base.metrics import headline_metric, iou_of
from lidarplace.files.secret_urls import hide_secrets
from sweeps.configuration.file import public_yaml
from sweeps.configuration.grid import Sweep
from sweeps.plan.labels import further_axes
from sweeps.plan.trial import DetectorTrial, Trial
from sweeps.results.trial_results import axis_values
from tracking.mlflow.content import Dataset

_SURROGATES_OF_VIEW = ("s_mig", "expected_recall")
_LONGEST_CONFIG = 4000
"""Characters of a configuration in a note; MLflow refuses longer ones, the artifacts have all."""

ABOUT = """\
A sweep over LiDAR placements: one parent run, and a child run for every trained detector.

- Metrics: `surrogate.NAME.CLASS` of the placement; `AP_R40_3D.CLASS.IOU`, `AP_R40_BEV.CLASS.IOU`
  and `recall.CLASS.IOU` in percent on test frames; `seconds` of training and evaluation;
  `requirement.NAME`, what there is of it in terms of what is needed, `requirements_failed` and
  `requirements_open`.
- Tags to filter by: `tags.placement = 'line'`, `tags.detector`, `tags.seed`, `tags.density`,
  `tags.scene`, and the axes of the grid, in backquotes: ``tags.`scene.density` = '80'``.
- The parent run has the command, the configuration, the report and the tables; a child run has the
  picture of its placement and precision over recall.
- Placements with more than one run have seeds: compare their means, not the first row.
"""
"""Text of the experiment's page, Markdown."""


def columns(sweep: Sweep) -> list[str]:
    """Name the columns of the experiment's page: placement, surrogates, AP, recall, the rest."""
    point = sweep.points[0].point
    names = [name for name in _SURROGATES_OF_VIEW if name in point.surrogate.names]
    first, *others = (
        [*(f"metrics.surrogate.{name}.{c}" for name in names), headline_column(sweep, c)]
        for c in point.classes
    )
    axes = [f"params.{axis}" for axis in further_axes(sweep)]
    required = ["metrics.requirements_failed"] if sweep.common.requirements else []
    metrics = [*first, headline_column(sweep, "all"), *required, *chain(*others)]
    return ["params.placement", *metrics, *axes, "metrics.seconds"]


def headline_column(sweep: Sweep, object_class: str = "") -> str:
    """Name the column of the headline metric of a class, of the first one by default."""
    point = sweep.points[0].point
    name = object_class or point.classes[0]
    iou = iou_of(name, point.own_ious()).strict
    return f"metrics.{headline_metric(name)}.{name}.{iou:.2f}"


def chart(sweep: Sweep) -> tuple[str, str] | None:
    """Name the columns of the experiment's chart: AP of the first class over its S-MIG."""
    point = sweep.points[0].point
    has_both = point.detector is not None and "s_mig" in point.surrogate.names
    x = f"metrics.surrogate.s_mig.{point.classes[0]}"
    return (x, headline_column(sweep)) if has_both else None


def note(source: Mapping[str, object], command: str, addresses: Iterable[str]) -> str:
    """Describe how to make a sweep or a search of a configuration again, Markdown, without secrets.

    `addresses` are those whose secrets are hidden."""
    config = public_yaml(source)
    command = hide_secrets(command, *addresses)
    if len(config) > _LONGEST_CONFIG:
        config = config[:_LONGEST_CONFIG] + "\n# … the rest is in the artifact config.yaml"
    command = command.replace(" --set ", " \\\n    --set ")  # a page is not as wide as a terminal
    machine = f"{platform.node()}: {os.cpu_count()} CPUs, {platform.platform()}"
    python = f"Python {platform.python_version()}"
    return (
        f"Run again with\n\n```sh\n{command}\n```\n\n"
        f"Machine of the driver: {machine}, {python}.\n\n"
        f"Configuration, overrides included:\n\n```yaml\n{config}```\n"
    )


def tags(trial: Trial, axes: Sequence[str]) -> dict[str, object]:
    """Return the tags that runs are filtered by."""
    point = trial.grid_point.point
    scene = point.scene.model_dump(mode="json")
    place = {"scene": trial.scene_label}
    if scene["source"] == "log":
        place["folder"] = scene["folder"]
    else:
        place["density"] = scene["density"]
        place["town"] = ", ".join(scene["towns"])
    trial_tags = {"placement": point.placement, "detector": point.detector_name, "seed": point.seed}
    return {**trial_tags, **place, **axis_values(trial, axes)}


def datasets(trial: DetectorTrial) -> list[Dataset]:
    """List the frames that a trial was trained and tested on; the digest is the store's key."""
    contexts: tuple[Literal["train", "test"], ...] = ("train", "test")
    collected, frames_of_trial = (trial.learns.inputs, trial.collect_test), []
    counts = trial.grid_point.point.frame_counts()
    for context, tasks, frames in zip(contexts, collected, counts, strict=True):
        of_split = (task for task in tasks if getattr(task.stage, "split", None) == context)
        scenes = [task.inputs[0] for task in of_split]
        name, keys = f"{trial.scene_label} {context}", "/".join(task.key for task in scenes)
        digest = keys if len(scenes) == 1 else hashlib.sha256(keys.encode()).hexdigest()[:24]
        labels = {"scene": ", ".join(task.label for task in scenes)}
        frames_of_trial.append(Dataset(name, digest, context, labels, {"frames": frames}))
    return frames_of_trial
