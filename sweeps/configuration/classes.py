"""The classes of a sweep: which names are possible, and what can be said of each."""

from typing import Annotated, Any

from pydantic import Field, field_validator

from lidarplace.base.metrics import Overlaps
from lidarplace.configuration.settings import ClassName, Distance, Probability, Settings

Side = Annotated[Distance, Field(gt=0)]
Share = Annotated[Probability, Field(gt=0, lt=1)]


class ClassSettings(Settings):
    """Settings of one class."""

    size: tuple[Side, Side, Side] | None = Field(
        None,
        description="length, width, height of its anchors, metres; by default Car, Cyclist and "
        "Pedestrian have those of the detector's preset, other classes the mean size of their "
        "objects in the training frames",
    )
    iou: tuple[Share, Share] | None = Field(
        None,
        description="3D IoU above which a detection is true, strict and loose; by default KITTI's: "
        "0.7 and 0.5 for Car, 0.5 and 0.25 for all others",
    )
    curve: ClassName | None = Field(
        None,
        description="class whose detection curve is used by expected_recall, if "
        "surrogate.curves has none of this class",
    )
    colour: str | None = Field(
        None,
        pattern="^#[0-9A-Fa-f]{6}$",
        description="colour of its boxes in pictures, such as #CC79A7",
    )

    @field_validator("iou")
    @classmethod
    def _strict_first(cls, iou: tuple[float, float] | None) -> Any:
        if iou is not None and not iou[0] > iou[1]:
            raise ValueError("expected [strict, loose] with strict > loose")
        return iou

    @property
    def overlaps(self) -> Overlaps | None:
        """The IoUs in the terms of `lidarplace`; None: KITTI's."""
        return None if self.iou is None else Overlaps(*self.iou)
