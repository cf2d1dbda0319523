"""What MLflow shows of a sweep and its trials besides results: tags, data, a note, columns."""

import hashlib
import os
import platform
from collections.abc import Iterable, Mapping, Sequence

from lidarplace.base.metrics import Overlaps, headline_metric, iou_of
from lidarplace.files.secret_urls import hide_secrets
from sweeps.configuration.file import public_yaml
from sweeps.configuration.grid import Sweep
from sweeps.plan.plan import further_axes
from sweeps.plan.trial import DetectorTrial, Trial
from sweeps.results.trial_results import axis_values
from sweeps.tasks.task import Task
from tracking.mlflow.content import Dataset

_SHOWN_SURROGATES = ("expected_ig", "s_mig", "covered_entropy")
_LONGEST_CONFIG = 4000
"""Characters; MLflow refuses a longer note. The whole is among the artifacts."""

ABOUT = """\
A sweep over LiDAR placements: one parent run, and a child run for every trained detector.

- Metrics: `surrogate.NAME.CLASS` of the placement; `AP_R40_3D.CLASS.IOU`, `AP_R40_BEV.CLASS.IOU`
  and `recall.CLASS.IOU` in percent on test frames; `seconds` of training and evaluation;
  `requirement.NAME`, what there is of it in terms of what is needed, and `requirements_failed`.
- Tags to filter by: `tags.placement = 'line'`, `tags.detector`, `tags.seed`, `tags.density`,
  `tags.scene`, and the axes of the grid, in backquotes: ``tags.`scene.density` = '80'``.
- The parent run has the command, the configuration, the report and the tables; a child run has the
  picture of its placement and precision over recall.
- Placements with more than one run have seeds: compare their means, not the first row.
"""
"""The text of the experiment's page, Markdown."""


def columns(sweep: Sweep) -> list[str]:
    """What the experiment's page shows of every run; the first orders them."""
    point = sweep.points[0].point
    ious = point.own_ious()
    first = [_column(name, ious) for name in point.classes]
    shown = [name for name in _SHOWN_SURROGATES if name in point.surrogate.names]
    surrogates = [f"metrics.surrogate.{name}.{c}" for c in point.classes for name in shown]
    axes = [f"params.{axis}" for axis in further_axes(sweep)]
    required = ["metrics.requirements_failed"] if sweep.common.requirements else []
    return [*first, _column("all", ious), *required, *surrogates, *axes, "metrics.seconds"]


def _column(object_class: str, ious: Mapping[str, Overlaps]) -> str:
    """What a class is judged by, as MLflow knows it."""
    iou = iou_of(object_class, ious).strict
    return f"metrics.{headline_metric(object_class)}.{object_class}.{iou:.2f}"


def note(source: Mapping[str, object], command: str, addresses: Iterable[str]) -> str:
    """How to make a sweep or a search again, Markdown.

    Args:
        source: the configuration.
        addresses: whose secrets are not shown.
    """
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
    """What runs are filtered by."""
    point = trial.grid_point.point
    scene = point.scene.model_dump(mode="json")
    place = {"scene": trial.scene_label}
    if scene["source"] == "log":
        place["folder"] = scene["folder"]
    else:
        place["density"] = scene["density"]
        place["town"] = ", ".join(scene["towns"])
    own = {"placement": point.placement, "detector": point.detected_by, "seed": point.seed}
    return {**own, **place, **axis_values(trial, axes)}


def datasets(trial: DetectorTrial) -> list[Dataset]:
    """The recorded frames that a trial was trained and tested on; the digest is the store's key."""
    train, test = trial.grid_point.point.scene.frame_counts()
    collected = {"train": trial.learns.inputs, "test": trial.collect_test}
    found = []
    for context, frames in (("train", train), ("test", test)):
        scenes = [
            t.inputs[0]
            for t in collected[context]
            if t.stage == "collect" and t.params.split == context
        ]
        found.append(
            Dataset(
                name=f"{trial.scene_label} {context}",
                digest=_digest(scenes),
                context="train" if context == "train" else "test",
                source={"scene": ", ".join(task.label for task in scenes)},
                profile={"frames": frames},
            )
        )
    return found


def _digest(tasks: Sequence[Task]) -> str:
    if len(tasks) == 1:
        return tasks[0].key
    return hashlib.sha256("/".join(task.key for task in tasks).encode()).hexdigest()[:24]
