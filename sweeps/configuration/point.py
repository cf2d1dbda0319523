"""The configuration of one point of a grid: a placement, its detector, scene and surrogates."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from lidarplace.base.class_names import check_among
from lidarplace.base.errors import InputError
from lidarplace.base.metrics import METRICS, Overlaps
from lidarplace.base.registry import OneOf
from lidarplace.base.roi import Roi
from lidarplace.base.suggestions import did_you_mean
from lidarplace.clouds.profiles import PROFILES
from lidarplace.configuration.mounting import MountingErrorSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import (
    ClassName,
    Count,
    CountFromOne,
    Distance,
    FilePath,
    Name,
    Probability,
    Seed,
    Settings,
    short_for,
)
from lidarplace.configuration.vehicle import OwnVehicle
from lidarplace.configuration.weather import WeatherSettings
from lidarplace.coverage import Method
from lidarplace.logs.boxes import CLASSES
from lidarplace.pog.surrogates.table import ASKED_FOR
from lidarplace.requirements.settings import Interval
from lidarplace.scenes.kinds import Scene
from lidarplace.scenes.recorded import LogScene
from lidarplace.scenes.routes import KEEP_M
from lidarplace.scenes.site import Site, SiteOrVehicle
from lidarplace.scenes.sumo.settings import SumoScene
from sweeps.configuration.evaluator import Evaluator, EvaluatorCommand
from training import DETECTORS
from training.settings import TrainingSettings

SurrogateName = Annotated[str, OneOf((ASKED_FOR,))]
MetricName = Annotated[str, OneOf((METRICS.where(lambda own: True),))]

MOST_VOXELS = 2_000_000_000
"""Most voxels of a POG, which counts in int32, so these take 8 GB for each class.

A surrogate needs several times as much. Beyond, a mistyped resolution is likelier than a machine
that holds them."""


class RoiSettings(Settings):
    """Region of interest in the ego frame, metres."""

    x: Interval = Field((0.0, 40.0), description="from back to front, metres")
    y: Interval = Field((-20.0, 20.0), description="from right to left, metres")
    z: Interval = Field((0.0, 4.0), description="above the ground, metres")

    fit: Literal["exact", "nearest"] = Field(
        "exact", description="nearest: sides become the nearest whole number of voxels"
    )


class LidarSettings(SensorSettings):
    """The LiDAR model of every mount without one, and how clouds are collected.

    `range_noise` and `drop_off` also hold for models that lack them, in mounts and searches."""

    profile: Literal[tuple(PROFILES)] = Field(  # type: ignore[valid-type]
        "paper",
        description="paper: the text of the paper; released-code: what its published collection "
        "code does: 250 azimuth steps and the two quirks below. Other keys override it.",
    )
    cloud_share: Probability = Field(
        1.0,
        gt=0,
        description="share of the azimuth steps that simulated clouds have: fewer points train "
        "faster; surrogates use all steps",
    )
    tilt_in_degrees: bool = Field(
        False, description="quirk: clouds are collected with roll and pitch interpreted as degrees"
    )
    misaligned_heights: bool = Field(
        False, description="quirk: clouds are merged without regard to the height of each sensor"
    )

    @model_validator(mode="before")
    @classmethod
    def _fill_from_profile(cls, data: Any) -> Any:
        name = data.get("profile") if isinstance(data, dict) else None
        if not isinstance(name, str) or name not in PROFILES:
            return data
        profile = PROFILES[name]
        return {
            "azimuth_steps": profile.lidar.azimuth_steps,
            "tilt_in_degrees": profile.tilt_in_degrees,
            "misaligned_heights": profile.misaligned_heights,
        } | data


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
        description="class whose detection curve is used by expected_recall; "
        "allowed only if surrogate.curves has none of this class",
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
            raise InputError(expected="[strict, loose] with strict > loose")
        return iou

    @property
    def overlaps(self) -> Overlaps | None:
        """IoUs in the terms of `lidarplace`; None: KITTI's."""
        return None if self.iou is None else Overlaps(*self.iou)


class SurrogateSettings(Settings):
    """Surrogates to compute, and their parameters."""

    names: tuple[SurrogateName, ...] = Field(
        ASKED_FOR.own, min_length=1, description="surrogates to compute"
    )
    resolution: Distance = Field(0.1, gt=0, description="edge of a voxel, metres")
    method: Method = Field(
        "cone",
        description="which voxels a placement sees: cone is exact, dda and bresenham follow single "
        "rays",
    )
    detection_probability: Probability = Field(
        0.1,
        gt=0,
        description="q of expected_ig: probability that a ray detects an object that it crosses",
    )
    occlusion: bool = Field(
        False, description="weaken the rays of expected_ig by the occupancy on their way"
    )
    curves: FilePath | None = Field(
        None,
        description="detection curves of expected_recall, a file of lidarplace calibrate; "
        "those of the package if null",
    )
    mount_draws: Count = Field(
        0,
        description="number of vehicles with mounting_errors over which expected_recall and other "
        "surrogates of objects are averaged; 0: exact mounts",
    )
    accuracy: bool = Field(
        True, description="study error against run time: methods, resolutions, azimuth steps"
    )
    sampling_error: bool = Field(
        True, description="study how much the surrogates change with other frames"
    )
    studied_placements: CountFromOne = Field(
        12,
        description="number of placements, spread over the grid, for accuracy and sampling_error; "
        "with promote, all that are trained",
    )


class GeneralistSettings(Settings):
    """A detector trained on the clouds of many rigs, which evaluates other rigs."""

    rigs: CountFromOne | tuple[Name, ...] = Field(
        32,
        description="number of random rigs, in and around the space of the placements of the "
        "sweep; or names of placements, which are then not evaluated",
    )
    rigs_per_frame: CountFromOne = Field(8, description="rigs per training frame")
    epochs: CountFromOne = Field(4, description="passes over frames and rigs")

    @field_validator("rigs", mode="before")
    @classmethod
    def _some(cls, rigs: Any) -> Any:
        # Not by the types of the field, whose error would name both of them.
        named = isinstance(rigs, (list, tuple)) and all(isinstance(name, str) for name in rigs)
        good = 0 < len(set(rigs)) == len(rigs) if named else type(rigs) is int and rigs >= 1
        if not good:
            raise InputError(expected="a number from 1, or a list of different placements")
        return rigs


class Point(SiteOrVehicle):
    """One point of the grid: it is trained and evaluated once."""

    placement: Name = Field(description="one of the paper's eight or of `placements`")
    detector: Annotated[str, DETECTORS] | None = Field(
        "pointpillars_tiny", description="null: surrogates only, without training"
    )
    seed: Seed = Field(0, description="seed of a training: weights, order of frames, augmentation")
    scene: Scene = Field(SumoScene(), description="traffic, simulated or recorded")
    roi: RoiSettings = Field(RoiSettings(), description="where objects count")
    classes: tuple[ClassName, ...] = Field(
        ("Car", "Cyclist", "Pedestrian"),
        min_length=1,
        description="classes of surrogates and detectors, by their names in the log; simulated "
        "traffic has these three",
    )
    class_settings: dict[ClassName, ClassSettings] = Field(
        default={}, description="class -> its anchors, IoUs, detection curve, colour"
    )
    lidar: Annotated[LidarSettings, short_for("name")] = Field(
        LidarSettings(), description="the LiDARs, unless a mount has its own"
    )
    vehicle: OwnVehicle = Field(
        None,
        description="body of the vehicle: it stops rays, and no LiDAR may be inside; a sedan by "
        "default, [] for none",
    )
    site: Site | None = Field(
        None,
        description="LiDARs on poles beside the road instead of a vehicle: mounts, ROI and zones "
        "are in its frame, z up to 15 m; {} is the junction with most lanes",
    )
    weather: WeatherSettings = Field(
        WeatherSettings(),
        description="fog and rain, in clouds and for surrogates; clear by default",
    )
    surrogate: SurrogateSettings = Field(SurrogateSettings(), description="scores of a placement")
    training: TrainingSettings = Field(TrainingSettings(), description="how detectors are trained")
    metrics: tuple[MetricName, ...] = Field((), description="further metrics, of plug-ins")
    evaluator: Evaluator = Field(
        "specialist",
        description="which detector evaluates a placement: specialist: one trained for it; "
        "generalist: one trained on many other rigs, in seconds a placement; finetuned: a "
        "specialist that starts from the generalist's weights; pretrained: the generalist of the "
        "package, or of training.checkpoint, without a training; a mapping: a command",
    )
    generalist: GeneralistSettings = Field(
        GeneralistSettings(), description="training of the generalist"
    )
    mounting_errors: MountingErrorSettings = Field(
        MountingErrorSettings(), description="mounting errors in simulated clouds"
    )

    @field_validator("classes")
    @classmethod
    def _different(cls, classes: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        if len(set(classes)) < len(classes):
            raise InputError(expected="each class once")
        strange = [name for name in classes if name not in CLASSES]
        if strange and isinstance(info.data.get("scene"), SumoScene):
            problem = f"simulated traffic has no {strange[0]}{did_you_mean(strange[0], CLASSES)}"
            raise InputError(problem, expected=", ".join(CLASSES))
        return classes

    @field_validator("scene")
    @classmethod
    def _has_the_frames_it_needs(cls, scene: Scene, info: ValidationInfo) -> Scene:
        tests = not (isinstance(scene, LogScene) and info.data.get("detector", "") is None)
        for split, count in zip(("train", "test"), scene.frame_counts(), strict=True):
            if count == 0 and (split == "train" or tests):
                raise InputError(f"no frame is in the {split} split", fix=scene.remedy(split))
        return scene

    @model_validator(mode="after")
    def _of_known_classes(self) -> Point:
        for key, named, classes in (
            ("class_settings", self.class_settings, self.classes),
            ("training.sample_groups", self.training.sample_groups, (*self.classes, *CLASSES)),
        ):
            check_among(named, classes, key=key)
        return self

    @model_validator(mode="after")
    def _seen_from_the_site(self) -> Point:
        if self.site is not None and isinstance(self.scene, LogScene):
            train, test = self.frame_counts()
            needed = {"train": train} | ({} if self.detector is None else {"test": test})
            for split in (split for split, count in needed.items() if not count):
                problem = (
                    f"no {split} frame has the recording vehicle within {self.site.within:g} m"
                )
                fix = "move the site, raise site.within, or record more"
                raise InputError(problem, key="site", fix=fix)
        return self

    @model_validator(mode="after")
    def _fits(self) -> Point:
        sides = (self.roi.x, self.roi.y, self.roi.z)
        voxels = math.prod((high - low) / self.surrogate.resolution for low, high in sides)
        if voxels > MOST_VOXELS:
            problem = f"{self.surrogate.resolution:g} m divides the ROI into {voxels:.3g} voxels"
            expected = f"at most {MOST_VOXELS:.3g}"
            raise InputError(problem, key="surrogate.resolution", expected=expected)
        self._fit_roi()
        if self.surrogate.mount_draws and not self.mounting_errors.errors():
            fix = "set mounting_errors, such as {offset: 0.01, angle_deg: 0.5}"
            raise InputError("no mount is off", key="surrogate.mount_draws", fix=fix)
        corner = math.hypot(*(max(map(abs, side)) for side in (self.roi.x, self.roi.y)))
        if isinstance(self.scene, SumoScene) and corner > KEEP_M:
            problem = f"the corner is {corner:.1f} m from the vehicle"
            expected = f"at most {KEEP_M:g} m, as simulated traffic is logged"
            raise InputError(problem, key="roi", expected=expected)
        return self

    @property
    def needs_voxels(self) -> bool:
        """Whether anything is computed on the voxels of the ROI."""
        return True

    def _fit_roi(self) -> None:
        """Replace the ROI by the nearest of whole voxels, if that is asked for or nothing needs it.

        Raises InputError: a side is not a whole number of voxels, and `fit` is exact."""
        sides = (self.roi.x, self.roi.y, self.roi.z, self.surrogate.resolution)
        if self.roi.fit == "exact" and self.needs_voxels:
            try:
                Roi(*sides)
            except InputError as error:
                raise InputError(
                    **vars(error) | {"fix": f"{error.fix}; or set roi.fit: nearest"}
                ) from None
            return
        roi = Roi.nearest(*sides)
        nearest = {axis: getattr(roi, axis) for axis in "xyz"}
        self.__dict__["roi"] = self.roi.model_copy(update=nearest)

    def frame_counts(self) -> tuple[int, int]:
        """Count training and test frames, those at the site alone."""
        if self.site is not None and isinstance(self.scene, LogScene):
            return self.scene.frame_counts(self.site)
        return self.scene.frame_counts()

    def own_ious(self) -> dict[str, Overlaps]:
        """Return the IoUs of classes that differ from KITTI's."""
        overlaps = {name: self.class_settings[name].overlaps for name in self.class_settings}
        return {name: iou for name, iou in overlaps.items() if iou is not None}

    @property
    def evaluator_name(self) -> str:
        """Name of the evaluator in tables."""
        return (
            self.evaluator.name if isinstance(self.evaluator, EvaluatorCommand) else self.evaluator
        )

    @property
    def detector_name(self) -> str | None:
        """Name of the detector in tables, which may be a command; None: there is none."""
        by_command = isinstance(self.evaluator, EvaluatorCommand) and self.detector is not None
        return self.evaluator_name if by_command else self.detector

    def voxel_roi(self) -> Roi:
        """Return the region of interest, divided into voxels."""
        return Roi(self.roi.x, self.roi.y, self.roi.z, self.surrogate.resolution)
