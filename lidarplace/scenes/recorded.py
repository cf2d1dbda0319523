"""A scene that was recorded before: a folder with a box log, from whatever source."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from lidarplace.box_log import BoxLog, read_box_log, read_frames
from lidarplace.boxes import SPLITS
from lidarplace.configuration.settings import FilePath, Seed, Settings
from lidarplace.scenes.parts import ScenePart


class LogScene(Settings):
    """A box log on disk, as `lidarplace.box_log.write_box_log` writes it."""

    source: Literal["log"] = Field(
        description="tells this kind of scene from others: a log that is there already"
    )
    folder: FilePath = Field(
        description="holds boxes.parquet, frames.parquet and, if there are any, buildings.parquet; "
        "column split of the frames says which train and which test"
    )
    clouds: Literal["simulated", "recorded"] = Field(
        "simulated",
        description="simulated: rays are cast at the boxes; recorded: the clouds in "
        "folder/clouds/PLACEMENT, such as CARLA's",
    )
    seed: Seed = Field(
        default=0, description="of shapes, drop-off and range noise of simulated clouds"
    )

    @field_validator("folder")
    @classmethod
    def _tells_train_from_test(cls, folder: Path) -> Path:
        split = read_frames(folder)["split"]
        other = split[~split.isin(SPLITS)]
        if len(other):
            raise ValueError(
                f"{folder / 'frames.parquet'}: row {other.index[0]}: split is {other.iloc[0]!r}; "
                "allowed are train and test"
            )
        return folder

    @property
    def name(self) -> str:
        """The scene's name in labels."""
        return self.folder.resolve().name

    def frame_counts(self) -> tuple[int, int]:
        """Number of training and of test frames."""
        split = read_frames(self.folder)["split"]
        return int((split == "train").sum()), int((split == "test").sum())

    def remedy(self, split: str) -> str:
        """What to change if there is no frame of a split."""
        return f"column split of {self.folder / 'frames.parquet'} has to name some"

    def digest(self) -> str:
        """Hash of the log's tables."""
        digest = hashlib.sha256()
        for path in sorted(self.folder.glob("*.parquet")):
            digest.update(path.name.encode() + path.read_bytes())
        return digest.hexdigest()

    def read(self) -> BoxLog:
        """The log. Raises ValueError that names the file if something is wrong with it."""
        return read_box_log(self.folder)


@dataclass(frozen=True)
class LogRecording:
    """A box log that is read.

    Attributes:
        digest: hash of its content: another log in the same folder is another scene.
    """

    scene: LogScene
    digest: str

    def record(self) -> BoxLog:
        """Read it. Raises as `LogScene.read` does."""
        return self.scene.read()


def log_parts(scene: LogScene) -> list[ScenePart]:
    """The log as one part."""
    train, test = scene.frame_counts()
    splits = tuple(s for s, count in (("train", train), ("test", test)) if count)
    return [ScenePart("", LogRecording(scene, scene.digest()), splits)]
