"""The stage that simulates or reads a part of a scene."""

from dataclasses import dataclass
from typing import Annotated

from lidarplace.base.code_version import PACKAGES
from lidarplace.base.foreign_code import foreign_code
from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.parts import Recording
from sweeps.stages.stage import Stage


@dataclass(frozen=True)
class SceneStage(Stage[BoxLog]):
    """Simulate or read a part of a scene that is recorded by itself."""

    recording: Annotated[Recording, "scene", "site"]

    name = "scene"
    order = 70

    def modules(self) -> tuple[str, ...]:
        return (*super().modules(), type(self.recording).__module__)

    def run(self) -> BoxLog:
        kind = type(self.recording)
        if kind.__module__.partition(".")[0] in PACKAGES:
            return self.recording.record()
        with foreign_code(f"{kind.__module__}.{kind.__qualname__}", (Exception,)):
            return self.recording.record()
