"""A scene that was recorded before: a folder with a box log, from whatever source."""

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from lidarplace.base.class_names import IGNORE
from lidarplace.base.code_version import OMIT_DEFAULT
from lidarplace.base.errors import InputError, at
from lidarplace.configuration.settings import FilePath, Name, Seed, Settings
from lidarplace.files.atomic import reading
from lidarplace.files.regular import regular
from lidarplace.logs.box_log import (
    RIG_FILE,
    WORLD_FILE,
    BoxLog,
    read_box_log,
    read_frames,
    read_rigs,
)
from lidarplace.logs.boxes import SPLITS
from lidarplace.rigs.recorded import RecordedRig, one_rig
from lidarplace.scenes.datasets.class_maps import PAPER, PAPER_GROUPS, ClassMap, check_class_map
from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.sanity_checks.check_log import check_log
from lidarplace.scenes.sanity_checks.copies import copied_test_frames
from lidarplace.scenes.site import Site, near, seen_from


class LogScene(Settings):
    """A box log on disk, as `lidarplace.logs.box_log.write_box_log` writes it."""

    source: Literal["log"] = Field(description="scene type: an existing box log")
    folder: FilePath = Field(
        description="folder of boxes.parquet, frames.parquet and optionally buildings.parquet; "
        "column split of the frames divides training and test frames"
    )
    test_folder: FilePath | None = Field(
        None,
        description="a log whose test frames replace those of folder; trainings do not depend on "
        "it",
    )
    clouds: Literal["simulated", "recorded"] = Field(
        "simulated",
        description="simulated: rays are cast at the boxes; recorded: the clouds in "
        "folder/clouds/PLACEMENT, such as CARLA's, and those in folder/clouds/recorded of "
        "placements that name LiDARs of the recorded rig",
    )
    class_map: dict[Name, Name] | Literal["paper"] | None = Field(
        None,
        exclude_if=lambda value: value is None,  # told as before there was one
        description="classes of the log that count as others, such as {Truck: Cyclist}, or paper "
        "for its grouping of the names of data sets; ignore leaves boxes out; null: as they are",
    )
    seed: Seed = Field(
        default=0, description="seed of shapes, drop-off and range noise of simulated clouds"
    )

    @field_validator("folder", "test_folder")
    @classmethod
    def _tells_train_from_test(cls, folder: Path | None) -> Path | None:
        if folder is not None:
            read_frames(folder)  # raises ValueError for other splits
        return folder

    @field_validator("class_map", mode="before")
    @classmethod
    def _mapping_or_paper(cls, class_map: Any) -> Any:
        # Not by the types of the field, whose error would name all of them.
        if isinstance(class_map, dict):
            check_class_map(class_map, "class_map")
        elif class_map not in (None, PAPER):
            raise InputError(expected="paper, or a mapping such as {Truck: Cyclist}")
        return class_map

    @model_validator(mode="after")
    def _of_one_log(self) -> Self:
        if self.test_folder is not None and self.clouds == "recorded":
            raise InputError("recorded clouds have one folder", key="test_folder", expected="null")
        return self

    def __hash__(self) -> int:
        return hash(self.model_dump_json())  # a mapping has no hash of its own

    @property
    def name(self) -> str:
        """The scene's name in labels."""
        return self.folder.resolve().name

    def frame_counts(self, site: Site | None = None) -> tuple[int, int]:
        """Count training and test frames, those at a site if there is one.

        Raises ValueError: a log without poses cannot have a site."""
        if site not in self._counts:
            tests, counts = self.test_folder or self.folder, []
            for split, folder in zip(SPLITS, (self.folder, tests), strict=True):
                frames = read_frames(folder)
                frames = frames if site is None else frames[near(frames, site)]
                counts.append(int((frames["split"] == split).sum()))
            self._counts[site] = counts[0], counts[1]
        return self._counts[site]

    @cached_property
    def _counts(self) -> dict[Site | None, tuple[int, int]]:
        """Counts of `frame_counts`, once each."""
        return {}

    @property
    def real_clouds(self) -> Path:
        """Folder of the clouds of the recorded rig, which has a folder each scene."""
        return self.folder / "clouds" / "recorded"

    @cached_property
    def rig(self) -> RecordedRig:
        """The rig that recorded the folder's log, the same for all its scenes (`one_rig`).

        Raises ValueError if a scene has none, or another one than the others."""
        rigs, scenes = read_rigs(self.folder), set(read_frames(self.folder)["scene"])
        with at(self.folder / RIG_FILE):
            rig = one_rig(rigs)
            if lacking := scenes - rigs.keys():
                raise InputError("no recorded rig", place=f"scene {min(lacking)}")
        return rig

    def remedy(self, split: str) -> str:
        """Say what to change if there is no frame of a split."""
        return f"column split of {self.folder / 'frames.parquet'} has to name some"

    def digest(self) -> str:
        """Hash the tables, rigs and static worlds, and the class map `paper` if it counts."""
        digest = hashlib.sha256()
        extra = [path for name in (RIG_FILE, WORLD_FILE) for path in self.folder.glob(name)]
        for path in sorted([*self.folder.glob("*.parquet"), *extra]):
            with reading(path):
                digest.update(path.name.encode() + regular(path).read_bytes())
        if self.class_map == PAPER:  # whose content is data of the package
            digest.update(repr(sorted(PAPER_GROUPS.items())).encode())
        return digest.hexdigest()

    def read(self, site: Site | None = None) -> BoxLog:
        """Read the log, as it is seen from a site if there is one.

        Raises ValueError that names the file if something is wrong with it."""
        log = read_box_log(self.folder)
        if site is not None:
            with at(self.folder):
                log = seen_from(log, site)
        if self.class_map is None:
            return log
        groups = self.groups()
        names = log.boxes["class"].map(lambda name: groups.get(name, name))
        boxes = log.boxes.assign(**{"class": names})[(names != IGNORE).to_numpy()]
        return replace(log, boxes=boxes.reset_index(drop=True))

    def cautions(self) -> tuple[str, ...]:
        """List implausible values of the log, a line each.

        Raises InputError for values that are certainly wrong, and for test routes that are training
        routes."""
        return _cautions(tuple(part.recording for part in log_parts(self)))

    def groups(self) -> ClassMap:
        """Return the class map of the log's classes; others stay as they are."""
        return PAPER_GROUPS if isinstance(self.class_map, str) else self.class_map or {}


@dataclass(frozen=True)
class LogRecording:
    """A box log that is read; by `digest` another log in the same folder is another scene."""

    scene: LogScene
    digest: str
    site: Site | None = field(default=None, metadata={OMIT_DEFAULT: True})

    def record(self) -> BoxLog:
        """Read it; raise as `LogScene.read` does, and if the log is not what it was."""
        if self.scene.digest() != self.digest:
            problem, fix = "the log has changed since the command was given", "give it again"
            raise InputError(problem, place=self.scene.folder, fix=fix)
        return self.scene.read(self.site)


def log_parts(scene: LogScene, site: Site | None = None) -> list[ScenePart]:
    """List the log as one part, and the log of its test frames as another if it is one.

    Raises ValueError: recorded clouds are of the vehicle, not of a site."""
    if site is not None and scene.clouds == "recorded":
        problem = "recorded clouds are of the vehicle, not of a site"
        raise InputError(problem, key="scene.clouds", expected="simulated")
    counts = dict(zip(SPLITS, scene.frame_counts(site), strict=True))
    # Constructed, not copied: counts of frames are not those of the copy.
    train = LogScene.model_construct(**(dict(scene) | {"test_folder": None}))
    if scene.test_folder is None:
        splits = tuple(split for split, count in counts.items() if count)
        return [ScenePart("", LogRecording(train, train.digest(), site), splits)]
    test = LogScene.model_construct(**(dict(train) | {"folder": scene.test_folder}))
    return [
        ScenePart(name, LogRecording(log, log.digest(), site), (split,))
        for name, log, split in (("", train, "train"), ("test log", test, "test"))
        if counts[split]
    ]


@lru_cache(maxsize=8)
def _cautions(recordings: tuple[LogRecording, ...]) -> tuple[str, ...]:
    logs = {recording.scene.folder: recording.record() for recording in recordings}
    cautions = [caution for folder, log in logs.items() for caution in check_log(log, folder)]
    if len(logs) > 1:
        (_, train), (folder, test) = logs.items()
        cautions += check_log(test, folder, copied_test_frames(train, test))
    return tuple(cautions)
