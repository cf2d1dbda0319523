"""Metrics of detections, in the order of display.

A metric of ours is computed in `training.kitti_ap`; others: docs/extending.md."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from lidarplace.base.registry import Registry

Direction = Literal["maximize", "minimize"]
"""Direction of better values."""


STRICT = ConfigDict(strict=True, extra="forbid")
"""Configuration of what plug-ins register: each field has its type, and there are no others."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Metric:
    """A measure of detections. Raises ValueError for a wrong field.

    Attributes:
        label, short: its name in figures and tables, and where there is little room.
        direction: which values are best.
        of_all: whether it is one of all objects together, class "all", too.
        ranks: whether reports, rungs of `promote` and searches compare placements by it.
        headline: whether headlines report it for a class; with `of_all`, of all objects.
        of_one_iou: whether it is measured at single IoUs; else tables have `EVERY_IOU`.
        of_matches: computes it from `training.matches.Matches`; None for ours."""

    label: Annotated[str, Field(min_length=1)]
    short: str
    unit: str = "%"
    direction: Direction = "maximize"
    of_all: bool = False
    ranks: bool = False
    headline: bool = False
    of_one_iou: bool = True
    of_matches: Callable[[Any], float] | None = None


_OWN = {
    "AP_R40_3D": Metric(label="3D AP", short="3D", ranks=True, headline=True),
    "AP_R40_BEV": Metric(label="BEV AP", short="BEV", ranks=True),
    "AP_R40_3D_mean": Metric(
        label="3D AP @ 0.3–0.8", short="3D@0.3–0.8", ranks=True, of_one_iou=False
    ),
    "class_recall_3D": Metric(label="recall of the class", short="class recall"),
    "recall": Metric(label="recall", short="recall", of_all=True, ranks=True, headline=True),
    "mean_overlap": Metric(
        label="mean overlap", short="overlap", of_all=True, ranks=True, of_one_iou=False
    ),
}

METRICS = Registry(
    "lidarplace.metrics", _OWN, fits=lambda m: isinstance(m, Metric) and m.of_matches is not None
)
"""Metrics by name, ours in the order of display."""

RANKING = METRICS.where(lambda metric: metric.ranks)
"""Metrics by which placements are compared."""

OF_CLASSES = METRICS.where(lambda metric: not metric.of_all)
"""Metrics of each class alone."""


def headline_metric(object_class: str) -> str:
    """Return the metric of headlines for a class: 3D AP, and recall for all classes together.

    All classes have no AP."""
    of_all = object_class == "all"
    return next(n for n, m in _OWN.items() if m.headline and m.of_all == of_all)


HEADLINE_METRIC = headline_metric("")
"""Metric of headlines for a single class."""


EVERY_IOU = 0.0
"""IoU in tables of a metric without a single IoU."""

MEAN_AP_IOU = tuple(step / 100 for step in range(30, 81, 5))
"""IoUs over which "AP_R40_3D_mean" is a mean: 0.3, 0.35, …, 0.8."""


class Overlaps(NamedTuple):
    """IoUs above which a detection is true."""

    strict: float
    loose: float


def kitti_iou(object_class: str) -> Overlaps:
    """Return KITTI's IoUs of a class: 0.7 and 0.5 for Car, 0.5 and 0.25 for others."""
    return Overlaps(0.7, 0.5) if object_class == "Car" else Overlaps(0.5, 0.25)


def iou_of(object_class: str, of_classes: Mapping[str, Overlaps]) -> Overlaps:
    """Return the IoUs of a class in `of_classes`, or KITTI's."""
    return of_classes.get(object_class) or kitti_iou(object_class)
