"""The studio without a page: rigs that a person changes, and their numbers."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.command_line.invocation import command
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLASSES
from lidarplace.mounting.polygon import GRID_DIGITS, nearest
from lidarplace.mounting.zone import distance
from lidarplace.requirements.check_requirements import RequirementResult
from lidarplace.rigs.placement import Placement
from lidarplace.studio import blind_ground
from lidarplace.studio import rig as edits
from lidarplace.studio import violations as limits
from lidarplace.studio.best_pose import BestPose, best_addition, improved
from lidarplace.studio.frame_view import FrameView
from lidarplace.studio.log_frames import LogFrames
from lidarplace.studio.numbers import Meter, Numbers
from lidarplace.studio.rig import Rig
from lidarplace.studio.rigs_file import RigsFile, as_yaml, write_rigs
from lidarplace.studio.sweep_files import RUNS, evaluation_of, is_evaluation, sweep_of
from lidarplace.studio.violations import ReportedViolation
from lidarplace.studio.why_unseen import AimedRays, why_unseen

if TYPE_CHECKING:
    import plotly.graph_objects as go

PAPER_ROI = Roi((-40, 40), (-20, 20), (0, 4), 0.2)
"""The paper's region, all around the vehicle."""


@dataclass(frozen=True)
class Draft:
    """The rigs, and which of them is selected."""

    rigs: tuple[Rig, ...]
    current: int = 0


class History:
    """A draft that changes, and its former values.

    While something is dragged `value` is set all the time; `keep` makes one step of all of it."""

    def __init__(self, value: Draft) -> None:
        self.value = value
        self._steps, self._at = [value], 0

    def do(self, value: Draft) -> None:
        """Change the value, as one step."""
        self.keep()
        self.value = value
        self.keep()

    def keep(self) -> None:
        """End the step that is under way, if the value has changed."""
        if self.value != self._steps[self._at]:
            self._at += 1
            self._steps[self._at :] = [self.value]

    def go(self, by: int) -> bool:
        """Undo (-1) or redo (1) a step; return whether there is one."""
        self.keep()
        exists = 0 <= self._at + by < len(self._steps)
        self._at += by * exists
        self.value = self._steps[self._at]
        return exists


class Studio:
    """Rigs of a file, changed step by step, and measured on a log.

    Methods take a LiDAR's index in the rig, from 0; texts number LiDARs from 1. Poses are
    coordinates of the ego frame in metres and degrees. Several threads may use a studio: edits come
    one after the other.

    All frames of the log count; `folder` is that of the whole log, if it has some of them only: all
    can be looked at. `left_out` are its classes that have no numbers, and are in no sweep. Raises
    ValueError: the log has no frame, a box is bad, or a requirement cannot be laid out."""

    def __init__(
        self, file: RigsFile, log: BoxLog, roi: Roi = PAPER_ROI, folder: Path | None = None
    ) -> None:
        if log.frames.empty:
            raise ValueError("the log has no frame")
        classes = set(log.boxes["class"])
        self.layouts = file.layouts  # raises for a bad requirement before anything else is done
        self.file, self.log, self.roi = file, log, roi
        self.classes = tuple(c for c in CLASSES if c in classes) or CLASSES
        self.left_out = tuple(sorted(classes.difference(self.classes)))
        self._initial = {rig.name: rig for rig in file.rigs}
        self._history = History(Draft(file.rigs))
        self._editing, self._viewing = threading.Lock(), threading.Lock()
        self._frames = LogFrames(log, folder)
        self._frame = self.frame_numbers[0]
        self._view = self._view_of(self._frame)
        self._checked: tuple[Placement | None, Sequence[RequirementResult]] = (None, ())

    @cached_property
    def meter(self) -> Meter:
        """Measures of the rigs on the log."""
        return Meter(self.log, self.roi, self.classes, self.file.carrier)

    def prepare(self) -> Meter:
        """Build the meter, which takes seconds, and return it."""
        return self.meter

    # Which rig, and which frame.

    @property
    def rigs(self) -> tuple[Rig, ...]:
        """Rigs of the draft as they are now."""
        return self._history.value.rigs

    @property
    def rig(self) -> Rig:
        """The selected rig."""
        draft = self._history.value
        return draft.rigs[draft.current]

    @property
    def initial(self) -> Rig:
        """The selected rig as it is in the file; of a copy, what it was copied from."""
        return self._initial[self.rig.name]

    def choose(self, name: str) -> None:
        """Select another rig. Raises ValueError if there is none of that name."""
        names = [rig.name for rig in self.rigs]
        if name not in names:
            raise InputError("no such rig", expected=", ".join(names), found=repr(name))
        with self._editing:
            self._history.do(replace(self._history.value, current=names.index(name)))

    def copy_rig(self, name: str) -> None:
        """Select a copy of the rig under another name. Raises ValueError: it is empty or taken."""
        if not name or name in [rig.name for rig in self.rigs]:
            raise InputError(key="rig", expected="a new name", found=repr(name))
        self._initial[name] = self._initial.get(self.rig.name, self.rig)
        rigs = (*self.rigs, replace(self.rig, name=name))
        with self._editing:
            self._history.do(Draft(rigs, len(rigs) - 1))

    def show_frame(self, number: int) -> None:
        """Look at another frame. Raises ValueError if the log does not have it."""
        self._frames.check(number)
        self._frame = number

    @property
    def frame_numbers(self) -> list[int]:
        """Numbers of the frames that can be looked at."""
        return self._frames.numbers

    @property
    def view(self) -> FrameView:
        """The selected frame, read on demand. Raises ValueError: a box or the file is bad."""
        with self._viewing:
            if self._view.number != self._frame:
                self._view = self._view_of(self._frame)
            return self._view

    def _view_of(self, number: int) -> FrameView:
        log = self._frames.log_of(number)
        return FrameView(log, number, self.roi, self.classes, self.file.carrier)

    # Edits, each a step that can be undone.

    def pose(self, number: int, /, **pose: float) -> None:
        """Give a LiDAR other coordinates: x, y, z in metres, roll, pitch, yaw in degrees.

        Raises ValueError: a number is beyond its limits."""
        self._do(edits.posed, number, **pose)

    def drag(self, number: int, /, **pose: float) -> None:
        """Change a pose as part of one step that `drop` ends. Raises as `pose`."""
        with self._editing:
            self._history.value = self._with(edits.posed(self.rig, number, **pose))

    def drop(self) -> None:
        """End the step of `drag`."""
        with self._editing:
            self._history.keep()

    def add(self, model: str | None = None, **pose: float) -> None:
        """Mount one more LiDAR, of the catalogue's model or of the file's."""
        self._do(edits.added, model, **pose)

    def remove(self, number: int) -> None:
        """Take a LiDAR away."""
        self._do(edits.removed, number)

    def duplicate(self, number: int) -> None:
        """Mount the same LiDAR once more, to its left."""
        self._do(edits.duplicated, number)

    def mirror(self, number: int) -> None:
        """Mount its mirror image on the other side. Raises ValueError for one in the middle."""
        self._do(edits.mirrored, number)

    def enable(self, number: int, works: bool) -> None:
        """Let a LiDAR work, or be dead."""
        self._do(edits.enabled, number, works)

    def model(self, number: int, name: str | None) -> None:
        """Take another model of the catalogue; None: the file's. Raises ValueError without one."""
        self._do(edits.of_model, number, name)

    def snap(self, number: int) -> None:
        """Move a LiDAR to the nearest point of a zone. Raises ValueError without zones."""
        if not self.file.zones:
            raise InputError("has no zones", place=self.file.path)
        mount = self.rig.mounts[number]
        zone = min(self.file.zones, key=lambda z: distance(z, mount.x, mount.y, mount.z))
        x, y = nearest(zone.polygon, mount.x, mount.y)
        z = min(max(mount.z, zone.z[0]), zone.z[1])
        self.pose(number, x=round(x, GRID_DIGITS), y=round(y, GRID_DIGITS), z=z)

    def undo(self) -> bool:
        """Go a step back; return whether there was one."""
        with self._editing:
            return self._history.go(-1)

    def redo(self) -> bool:
        """Go a step forward again; return whether there was one."""
        with self._editing:
            return self._history.go(1)

    def _do(self, edit: Callable[..., Rig], *arguments: object, **pose: float) -> None:
        with self._editing:
            self._history.do(self._with(edit(self.rig, *arguments, **pose)))

    def _with(self, rig: Rig) -> Draft:
        draft = self._history.value
        rigs = [*draft.rigs]
        rigs[draft.current] = rig
        return replace(draft, rigs=tuple(rigs))

    # What the rig is worth.

    @property
    def placement(self) -> Placement | None:
        """The LiDARs that work; None if there is none, or if two are in one place."""
        return self.placement_of(self.rig)

    def placement_of(self, rig: Rig) -> Placement | None:
        """Return the LiDARs of a rig that work; None as for `placement`."""
        try:
            return rig.placement(self.file.lidar)
        except ValueError:  # is among the violations
            return None

    def numbers(self, exact: bool = True, rig: Rig | None = None) -> Numbers:
        """Return the numbers of a rig, by default the selected one as it is now."""
        return self.meter.measure(self.placement_of(rig or self.rig), exact)

    def totals(self, rig: Rig | None = None) -> dict[str, float]:
        """Return price, if the file has any, and power in watts of the LiDARs of a rig; or NaN."""
        rig, priced = rig or self.rig, bool(self.file.settings.prices)
        price = {"Price": math.fsum(limits.prices_of(rig, self.file))} if priced else {}
        return price | {"Power, W": math.fsum(limits.powers_of(rig, self.file))}

    def violations(self) -> tuple[ReportedViolation, ...]:
        """Return all limits and requirements of the file that the rig violates."""
        misplaced = self.misplaced()
        if self.placement is None:
            return (*misplaced, *limits.unmet_without_lidars(self.layouts))
        inapplicable = limits.inapplicable(self.rig, self.file).values()
        return (*misplaced, *inapplicable, *limits.unmet(self.outcomes()))

    def misplaced(self) -> tuple[ReportedViolation, ...]:
        """Return the violations without requirements, which take longer."""
        violations = limits.violations(self.rig, self.file)
        return (*violations, *limits.blind(self.rig, self.file, self.roi))

    def outcomes(self) -> Sequence[RequirementResult]:
        """Return the results of requirements that apply to the LiDARs; none without a LiDAR."""
        placement, (checked, results) = self.placement, self._checked
        if placement is None:
            return ()
        if placement != checked:
            results = limits.requirement_results(self.rig, self.file, self.layouts)
            self._checked = placement, results
        return results

    def ground(self, group: str) -> blind_ground.BlindGround | None:
        """Return ground around the vehicle to colour; None of an unknown group.

        With a group of `HEIGHTS_M` where nobody is seen, with one of `COUNTED_M` the number of
        LiDARs, with one of `FINDING` the expected recall, with a requirement where it fails."""
        around = self.placement, self.file.body
        if group in blind_ground.HEIGHTS_M:
            return blind_ground.blind_ground(*around, blind_ground.HEIGHTS_M[group])
        if group in blind_ground.COUNTED_M:
            return blind_ground.counted_ground(*around, blind_ground.COUNTED_M[group])
        if group in blind_ground.FINDING:
            return blind_ground.found_ground(*around, blind_ground.FINDING[group])
        results = (result for result in self.outcomes() if result.requirement.name == group)
        return next(map(blind_ground.failing_ground, results), None)

    # Questions.

    def improve(self, number: int) -> BestPose:
        """Move one LiDAR to where the rig finds most, and breaks no limit or requirement.

        What it breaks already may stay broken. Raises ValueError: the LiDAR is disabled, two are in
        one place, no object counts, or the rig was changed meanwhile."""
        rig = self.rig
        if not rig.lidars[number].enabled:
            raise ValueError(f"LiDAR {number + 1} does not work; enable it first")
        best = improved(rig, number, self.file, self.meter)
        self._as_it_was(rig)
        if best.after > best.before:
            self.pose(number, **edits.pose_of(best.mount))
        return best

    def add_best(self, model: str | None = None) -> BestPose:
        """Mount one more LiDAR where the rig then finds most, in any zone; else as `improve`.

        Of the catalogue's model or of the file's. Raises ValueError also: the model is unknown, no
        zone has room, or the limits allow no more LiDAR."""
        rig = self.rig
        best = best_addition(rig, model, self.file, self.meter)
        self._as_it_was(rig)
        self.add(model, **edits.pose_of(best.mount))
        return best

    def _as_it_was(self, rig: Rig) -> None:
        if self.rig is not rig:
            raise ValueError("the rig has changed since then; try again")

    def why_unseen(self, object_id: str) -> tuple[AimedRays, ...]:
        """Return what happens to the rays that the working LiDARs aim at an object of the frame.

        Raises ValueError: there is no such object, or no LiDAR."""
        return why_unseen(self.view.frame, object_id, self._working(), self.file.carrier)

    def plot(self) -> go.Figure:
        """Draw the frame as the rig sees it, in 3D, for a notebook or a page.

        Raises ValueError: no LiDAR works, or two are in one place."""
        from lidarplace.viewing.scene import draw_frame

        view, carrier = self.view, self.file.carrier
        log = self._frames.log_of(view.number)
        return draw_frame(log, view.number, self._working(), view.crop, vehicle=carrier)

    def _working(self) -> Placement:
        if self.placement is None:
            raise ValueError("no LiDAR works")
        return self.placement

    # Files.

    def save(self, path: Path | None = None, overwrite: bool = False) -> Path:
        """Write all rigs, in the file's own words, by default to that file; return the path.

        Raises OSError: it cannot be written; FileExistsError: it exists, without `overwrite`."""
        self.drop()
        path = self.file.path if path is None else path
        write_rigs(path, self.file.text_with(self.rigs), overwrite)
        return path

    def sweep(self, path: Path, scene: Mapping[str, Any], overwrite: bool = False) -> str:
        """Write the configuration of a sweep over the rigs that have LiDARs; return its command.

        `scene` is the traffic as a configuration has it, with frames to train and to test. Raises
        ValueError: no rig has a LiDAR, or one is inside of the body or sees nothing;
        FileExistsError: the file exists, without `overwrite`."""
        content = sweep_of(self.rigs, self.file, scene, self.roi, self.classes)
        write_rigs(path, as_yaml(content), overwrite)
        return command("run", str(path))

    def evaluation(self, path: Path, scene: Mapping[str, Any]) -> Path:
        """Write the configuration of a sweep in which a generalist evaluates the rigs as they work.

        One of the same name is brought up to date, see `evaluation_of`. Returns its run folder, for
        `found_by_sweep`. Raises ValueError as `sweep`, of the LiDARs that work, and for another
        file of that name."""
        before = read_yaml_file(path) if path.exists() else None
        if before is not None and not is_evaluation(before):
            raise InputError("exists, and is not an evaluation", place=path, fix="rename it")
        rigs = [edits.working(rig) for rig in self.rigs]
        sweep = sweep_of(rigs, self.file, scene, self.roi, self.classes)
        write_rigs(path, as_yaml(evaluation_of(sweep, self.file, before)), overwrite=True)
        return RUNS / path.stem
