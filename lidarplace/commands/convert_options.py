"""Options that the readers of `lidarplace convert` share."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from lidarplace.base.errors import InputError, at
from lidarplace.rig_files.mounted import check_lidars, lidars_in
from lidarplace.rig_files.mounts_yaml import read_mounts_yaml
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.datasets.class_maps import PAPER, named_class_map
from lidarplace.scenes.datasets.drives import Models

KEEP, LEVEL = "keep", "level"


@dataclass(frozen=True)
class LogOptions:
    """Options of all readers."""

    class_map: Annotated[
        str,
        typer.Option(
            "--class-map",
            metavar="paper|own|FILE",
            help="paper: Car, Cyclist (with trucks) and Pedestrian, as the paper groups them; own: "
            "names of the data set; or a YAML file of lines `category: class`, "
            "where class is any name, or ignore. Other categories keep the paper's grouping.",
        ),
    ] = PAPER
    lidar: Annotated[
        str | None,
        typer.Option(
            "--lidar",
            metavar="MODEL|LIDAR=MODEL,…",
            help="LiDAR model of the recording, from `lidarplace sensors`, such as vlp16; of "
            "several models one for each LiDAR of the rig",
        ),
    ] = None
    ground: Annotated[
        str,
        typer.Option(
            "--ground",
            metavar=f"{KEEP}|{LEVEL}",
            help="keep: do not change heights of boxes; level: move boxes to the ground z = 0, by "
            "the median underside of nearby boxes in each frame",
        ),
    ] = KEEP
    clouds: Annotated[
        Path | None,
        typer.Option(
            "--clouds",
            help="folder of the recorded clouds: count their points in boxes by LiDAR, and store "
            "them in OUT/clouds/recorded",
        ),
    ] = None
    world: Annotated[
        bool,
        typer.Option(
            "--world",
            help="with --clouds: build the static world of unlabelled static objects, and the "
            "ground; simulated rays stop there",
        ),
    ] = False

    def models(self) -> Models:
        """Return what `--lidar` names of the catalogue; raise ValueError for none."""
        if self.lidar is None:
            return None
        with at("--lidar"):
            if "=" not in self.lidar:
                return Lidar.named(self.lidar)
            pairs = [pair.partition("=") for pair in self.lidar.split(",")]
            return {name.strip(): Lidar.named(model.strip()) for name, _, model in pairs}

    def model(self) -> Lidar | None:
        """Return the one model of `--lidar`; raise ValueError for several."""
        models = self.models()
        if isinstance(models, Mapping):
            raise InputError(place="--lidar", expected="one model", found=self.lidar)
        return models

    def recorded_rig(self) -> RecordedRig | None:
        """Return the rig of all scenes, if it is given; raise ValueError for an invalid file."""
        return None


@dataclass(frozen=True)
class DataSetOptions(LogOptions):
    """Options of readers of data sets."""

    keep_ignored: Annotated[
        bool,
        typer.Option(
            "--keep-ignored",
            help="keep boxes of ignored categories as class Other: they hide objects behind them, "
            "and count in no other class",
        ),
    ] = False

    def arguments(self, ignored: Counter[str], several: bool = False) -> dict[str, Any]:
        """Return the arguments that readers share; `several`: LiDARs may have a model each."""
        return {
            "ignored": ignored,
            "class_map": named_class_map(self.class_map),
            "lidar": self.models() if several else self.model(),
            "keep_ignored": self.keep_ignored,
        }


@dataclass(frozen=True)
class RigOptions(LogOptions):
    """Options of readers of files without the rig that recorded them."""

    rig: Annotated[
        Path | None,
        typer.Option(
            "--rig",
            help="YAML file of mounts with names and models: the rig that recorded the log; "
            "`lidarplace rig` converts files of other tools",
        ),
    ] = None

    def recorded_rig(self) -> RecordedRig | None:
        """Read the rig in the file of mounts, with the LiDAR's model where a mount has none."""
        if self.rig is None:
            if self.lidar is not None:
                fix = "name its file: --rig"
                raise InputError("is the model of a rig", place="--lidar", fix=fix)
            return None
        mounted = lidars_in(read_mounts_yaml(self.rig))
        check_lidars(mounted, str(self.rig))
        models = []
        for each in mounted:
            model = self.model() if each.model is None else each.model.lidar()
            if model is None:
                fix = "name one with --lidar"
                raise InputError(f"{each.name} has no model", place=self.rig, fix=fix)
            models.append(model)
        placement = Placement(self.rig.stem, [each.mount for each in mounted], models)
        return RecordedRig(tuple(each.name for each in mounted), placement)


@dataclass(frozen=True)
class ReaderOptions(DataSetOptions, RigOptions):
    """Options of readers of data sets whose rig is in no file."""
