"""Checks of a box log: an error for impossible values, cautions for implausible ones."""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.plausibility import CHECKS_OF_FRAMES, ImplausibleValue, cautions_of
from lidarplace.scenes.sanity_checks.boxes import implausible_surroundings, implausible_units
from lidarplace.scenes.sanity_checks.copies import copied_test_frames, duplicate_boxes
from lidarplace.scenes.sanity_checks.motion import (
    implausible_axes,
    implausible_motion,
    implausible_poses,
    implausible_times,
)

CONVERTED = "change {remedy} of the mapping that converts it (`lidarplace convert table --propose`)"


def implausible_values(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Run all checks of a log."""
    return chain(
        implausible_poses(log),
        implausible_units(log),
        implausible_surroundings(log),
        implausible_times(log),
        duplicate_boxes(log),
        implausible_axes(log),
        implausible_motion(log),
        copied_test_frames(log, log),
    )


def check_log(
    log: BoxLog,
    place: Path | str,
    values: Iterable[ImplausibleValue] | None = None,
    fix: str = CONVERTED,
) -> list[str]:
    """Return cautions of implausible values, a line for each check.

    `values` are those that some checks returned; None: `implausible_values`. In `fix`, `{remedy}`
    is what to change. Raises InputError, which names `place`, for the first value that is certain.
    """
    values = implausible_values(log) if values is None else values
    return cautions_of((value, error_of(value, log, place, value.column, fix)) for value in values)


def error_of(
    value: ImplausibleValue, log: BoxLog, place: Path | str, column: str, fix: str
) -> InputError:
    """Return the error line of a value; `column` is the name that the source gives its column."""
    table = log.frames if value.check in CHECKS_OF_FRAMES else log.boxes
    problem, change = f"{value.problem}: {value.where(table)}", fix.format(remedy=value.remedy)
    return InputError(problem, place=place, key=f"column {column}", fix=change)
