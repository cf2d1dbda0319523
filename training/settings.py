"""Settings of the training of a detector, and of the selection of its boxes."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import (
    Angle,
    ClassName,
    Count,
    CountFromOne,
    Factor,
    FilePath,
    Probability,
    Settings,
)

Moment = Annotated[Probability, Field(lt=1)]

PRETRAINED = Path("pretrained")
"""Name of the packaged generalist, wherever a checkpoint is named."""

LARGEST_BATCH = 16  # frames of a step that `batch_size: auto` comes to at most


class TrainingSettings(Settings):
    """Settings of one fine-tuning; the defaults are the paper's, augmentation is KITTI's.

    Raises pydantic's ValidationError (a ValueError) that names the field, the limit and the value.
    """

    epochs: CountFromOne = Field(10, description="passes over the training frames")
    batch_size: Count | Literal["auto"] = Field(
        "auto",
        description="frames per step; auto: 4 on a CPU, on a GPU the largest power of two up to 16 "
        "that its memory holds",
    )
    frame_share: Probability = Field(
        1.0, gt=0, description="share of the training frames to use, evenly spread"
    )
    optimizer: Literal["adam_onecycle", "sgd"] = Field(
        "adam_onecycle",
        description="adam_onecycle: Adam with decoupled weight decay, learning rate and momentum "
        "on one cycle; sgd: stochastic gradient descent, same learning rates, fixed momentum",
    )
    lr: Factor = Field(0.01, gt=0, description="highest learning rate")
    weight_decay: Factor = Field(0.01, description="weight decay")
    momentum: Moment = Field(0.9, description="momentum of sgd")
    moms: tuple[Moment, Moment] = Field(
        (0.95, 0.85), description="first Adam coefficient at the ends and at the top of the cycle"
    )
    pct_start: Moment = Field(0.1, description="share of the steps that warm up")
    div_factor: Annotated[Factor, Field(ge=1)] = Field(
        10.0, description="the cycle starts at lr / div_factor"
    )
    grad_norm_clip: Factor = Field(10.0, gt=0, description="largest norm of the gradient")
    mixed_precision: bool | Literal["everywhere"] = Field(
        True,
        description="16-bit floats in trainings on a GPU; everywhere: in predictions, too, and on "
        "a CPU that has AVX512-BF16 or AMX",
    )

    sample_groups: dict[ClassName, Count] = Field(
        {"Car": 20, "Pedestrian": 15, "Cyclist": 15},
        description="ground-truth sampling: objects of other frames are pasted until a frame has "
        "so many of a class; {} pastes none",
    )
    flip_y: bool = Field(True, description="mirror left and right in every second frame")
    rotation: Annotated[Angle, Field(ge=0, le=math.pi)] = Field(
        math.pi / 4,
        description=(
            "largest random rotation about z, radians; objects that leave the range are dropped"
        ),
    )
    scaling: tuple[Factor, Factor] = Field(
        (0.95, 1.05), description="range of the random scale of points and boxes"
    )
    min_points: Count = Field(5, description="objects with fewer points are left out of training")

    checkpoint: FilePath | None = Field(
        None,
        description="weights to start from: OpenPCDet's, a file of lidarplace pretrain, or "
        "pretrained: the packaged weights",
    )
    new_heads: bool = Field(
        False, description="train new heads if the checkpoint has other classes; an error if false"
    )
    score_threshold: Probability | None = Field(
        None, description="lowest score of a detection; the detector's own if null"
    )
    nms_threshold: Probability | None = Field(
        None,
        description="largest bird's-eye IoU of two detections of a frame; the detector's own if "
        "null",
    )

    @field_validator("batch_size", mode="before")
    @classmethod
    def _number_or_auto(cls, value: Any) -> Any:
        # Not by the types of the field, whose error would name both of them.
        if value != "auto" and not (type(value) is int and value >= 1):
            raise InputError(expected="auto or a whole number from 1")
        return value

    @field_validator("mixed_precision", mode="before")
    @classmethod
    def _switch_or_everywhere(cls, value: Any) -> Any:
        if not isinstance(value, bool) and value != "everywhere":
            raise InputError(expected="true, false or everywhere")
        return value

    @model_validator(mode="after")
    def _scales(self) -> "TrainingSettings":
        low, high = self.scaling
        if not 0 < low <= high:
            raise InputError(key="scaling", expected="0 < low <= high", found=self.scaling)
        return self
