"""Edits of the rig on a page: which LiDAR is chosen, and how it changes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.studio.page.panel import FROM_FILE, NO_LIDAR, STEPS, Panel
from lidarplace.studio.rig import ANGLES, POSE
from lidarplace.studio.studio import Studio

if TYPE_CHECKING:
    import viser

ABOVE_M = 0.3
"""Height above the body at which a LiDAR is added, metres."""
POLE_M = 6.0
"""The same above the ground of a site."""


class Editing:
    """Changes the rig of a studio; mistakes are ValueErrors.

    `chosen` is the number of the selected LiDAR; another browser may have removed it."""

    def __init__(self, studio: Studio, panel: Panel) -> None:
        self._studio, self._panel = studio, panel
        self.chosen: int | None = 0 if studio.rig.lidars else None

    def one(self) -> int:
        """Return the chosen LiDAR. Raises ValueError without any."""
        self.choose_existing()
        if self.chosen is None:
            raise ValueError("there is no LiDAR; add one")
        return self.chosen

    def choose_existing(self) -> None:
        """Choose another LiDAR if the chosen one is gone."""
        number = len(self._studio.rig.lidars)
        if self.chosen is not None and self.chosen >= number:
            self.chosen = number - 1 if number else None

    def choose_last(self) -> None:
        """Choose the LiDAR that was mounted last."""
        self.chosen = len(self._studio.rig.lidars) - 1

    def choose_rig(self, name: str) -> None:
        """Select another rig."""
        self._studio.choose(name)
        self.chosen = 0 if self._studio.rig.lidars else None

    def choose_lidar(self, label: str) -> None:
        """Choose the LiDAR of that label."""
        self.chosen = None if label == NO_LIDAR else int(label.partition(":")[0])

    def typed(self, name: str, value: float) -> None:
        """Give the chosen LiDAR another coordinate."""
        self._studio.pose(self.one(), **{name: float(value)})

    def model_to_add(self) -> str | None:
        """Return the model of a LiDAR that is added; None: the file's."""
        return model_named(self._panel.to_add.value)

    def change(self, button: str) -> None:
        """Press one of the buttons that change which LiDARs there are."""
        studio = self._studio
        if button == "add":
            on_pole = studio.file.site is not None
            top = POLE_M if on_pole else round(studio.file.vehicle.height + ABOVE_M, 3)
            studio.add(self.model_to_add(), x=0.0, y=0.0, z=top)
        else:
            getattr(studio, "snap" if button == "to zone" else button)(self.one())
        if button in ("add", "duplicate", "mirror"):
            self.choose_last()

    def pulled(self, event: viser.TransformControlsEvent) -> bool:
        """Follow the handle of the chosen LiDAR; whether the pull goes on."""
        studio, number = self._studio, self.chosen
        if number is None or number >= len(studio.rig.lidars):
            return True
        if event.phase == "end":
            studio.drop()
            return False
        handle = event.target
        moved = dragged(studio.rig.pose(number), handle.position, handle.wxyz)
        if moved:
            studio.drag(number, **moved)
        return True


def model_named(name: str) -> str | None:
    """Return the model of a field; None: the file's."""
    return None if name == FROM_FILE else name


def dragged(
    before: Mapping[str, float], position: NDArray[np.float64], wxyz: NDArray[np.float64]
) -> dict[str, float]:
    """Return the coordinates of `POSE` that differ from `before` by more than half a step, rounded.

    What was not touched is left out, so that it stays as its file has it: also an angle that could
    be written as another, as 180 degrees and -180. `wxyz`, (4,), is the sensor-to-ego rotation."""
    turned = Rotation.from_quat(wxyz, scalar_first=True)
    old = Rotation.from_euler("ZYX", [before[name] for name in reversed(ANGLES)], degrees=True)
    now = dict(zip(POSE[:3], position.tolist(), strict=True))
    if math.degrees((turned * old.inv()).magnitude()) > 0.5 * STEPS["yaw"]:
        angles = turned.as_euler("ZYX", degrees=True).tolist()
        now |= dict(zip(reversed(ANGLES), angles, strict=True))
    moved = {name: value - before[name] for name, value in now.items()}
    moved |= {name: math.remainder(moved[name], 360) for name in ANGLES if name in moved}
    return {
        name: round(round(value / STEPS[name]) * STEPS[name], 6)
        for name, value in now.items()
        if abs(moved[name]) > 0.5 * STEPS[name]
    }
