"""Objectives of a search: surrogates, measured values, price, power and margin."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from lidarplace.base.errors import InputError
from lidarplace.base.metrics import RANKING, Direction, headline_metric
from lidarplace.base.registry import OneOf
from lidarplace.configuration.settings import ClassName, Factor, Settings, Text
from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.configuration.sweep import best_of

DEFAULT_METRIC = headline_metric("all")
"""The metric of the objective `generalist`: it distinguishes rigs best."""
GENERALIST, PRETRAINED = "generalist", "pretrained"
"""Prefixes of metrics that one detector for all rigs measures, such as generalist.recall."""
TOTALS = ("price", "power")
"""Totals over LiDARs: bounds and objectives."""
OF_RIG = (*TOTALS, "margin")
"""Objectives that need no traffic."""
_SURROGATES = SURROGATES.where(
    lambda own: own.beside is None and (own.decides is not None or not own.of_objects)
)


class ObjectiveSettings(Settings):
    """An objective of a search; `expected_ig.Car` is short for one class."""

    by: Annotated[str, OneOf((_SURROGATES, RANKING), OF_RIG)] = Field(
        description="a surrogate of the POG or of objects, a measured value, the price, the power, "
        "or the margin: the smallest ratio of found to needed over all requirements"
    )
    evaluator: Literal["generalist", "pretrained"] | None = Field(
        None,
        description="who measures a measured value: "
        "generalist: one detector, trained on many rigs of the space, evaluates a trial in "
        "seconds; "
        "generalist.recall is short for it, and generalist for that; pretrained: the generalist of "
        "the package, or of training.checkpoint, without a training; pretrained.recall likewise",
    )
    weights: dict[ClassName, Annotated[Factor, Field(gt=0)]] | None = Field(
        None, description="class -> weight in the sum; by default all classes, each once"
    )
    also: tuple[Text, ...] = Field(
        (),
        description="further measured values, such as [recall] or [recall.Pedestrian]: the "
        "objective is the mean of all; generalist.AP_R40_3D_mean.Car and recall is short for it",
    )
    direction: Direction | None = Field(
        None, description="maximize, but minimize for residual_entropy, price and power"
    )

    @field_validator("by")
    @classmethod
    def _varies(cls, by: str) -> str:
        if by in SURROGATES and SURROGATES[by].fixed:
            raise InputError("does not depend on the placement")
        return by

    @model_validator(mode="after")
    def _has_classes(self) -> ObjectiveSettings:
        of_classes = self.by in (*SURROGATES, *RANKING)
        if self.weights is not None and not (of_classes and self.weights):
            raise InputError(f"{self.by} has no classes", key="weights")
        if self.uses_generalist and not self.measured:
            problem = f"{self.by} is not measured by a detector"
            raise InputError(problem, expected=", ".join(RANKING))
        if self.also and not (self.measured and all(part.measured for part in self.parts)):
            raise InputError("is for values that detectors measure, such as recall", key="also")
        if len({part.best for part in self.parts}) > 1:
            raise InputError("all values have to be large, or all small", key="also")
        return self

    @property
    def name(self) -> str:
        """Name such as `expected_ig.Car`, or `expected_ig` for a sum over classes."""
        by = f"{self.evaluator}.{self.by}" if self.uses_generalist else str(self.by)
        if self.weights is not None and len(self.weights) == 1:
            by = f"{by}.{next(iter(self.weights))}"
        return " and ".join((by, *self.also))

    @cached_property
    def parts(self) -> tuple[ObjectiveSettings, ...]:
        """Values of which it is the mean: itself, then those of `also`."""
        alone = self.model_copy(update={"also": ()})
        return alone, *(ObjectiveSettings.model_validate(as_objective(name)) for name in self.also)

    @property
    def best(self) -> Direction:
        """Direction of the best values."""
        if self.of_traffic or self.measured:
            return self.direction or best_of(self.by)
        return self.direction or ("minimize" if self.by in TOTALS else "maximize")

    def weights_of(self, classes: Iterable[str]) -> dict[str, float]:
        """Return the weight by class in the sum, of classes that have one."""
        return dict(self.weights.items()) if self.weights else dict.fromkeys(classes, 1.0)

    @property
    def of_traffic(self) -> bool:
        """Whether it is computed on traffic, without a detector."""
        return not self.measured and self.by not in OF_RIG

    @property
    def measured(self) -> bool:
        """Whether detectors measure it."""
        return self.by in RANKING

    @property
    def uses_generalist(self) -> bool:
        """Whether a generalist measures it."""
        return self.evaluator is not None


def as_objective(value: Any) -> Any:
    """Return the settings of an objective that is written as text."""
    if not isinstance(value, str):
        return value
    settings: dict[str, Any] = {}
    if (evaluator := value.partition(".")[0]) in (GENERALIST, PRETRAINED):
        settings |= {"evaluator": evaluator}
        value = value.partition(".")[2] or DEFAULT_METRIC
    value, *also = (part.strip() for part in value.split(" and "))
    module, colon, value = value.rpartition(":")
    by, _, object_class = value.partition(".")
    by = module + colon + by
    settings |= {"also": tuple(also)} if also else {}
    return {"by": by} | settings | ({"weights": {object_class: 1.0}} if object_class else {})
