"""Checks of a box log: an error for impossible values, cautions for implausible ones."""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.sanity_checks.boxes import doubts_of_surroundings, doubts_of_units
from lidarplace.scenes.sanity_checks.copies import doubts_of_copies, doubts_of_duplicates
from lidarplace.scenes.sanity_checks.doubt import OF_FRAMES, Doubt
from lidarplace.scenes.sanity_checks.motion import doubts_of_motion, doubts_of_poses
from lidarplace.scenes.sanity_checks.times import doubts_of_times

CONVERTED = "change {remedy} of the mapping that converts it (`lidarplace convert table --propose`)"


def doubts_of_log(log: BoxLog) -> Iterator[Doubt]:
    """Run all checks of a log, and yield their doubts."""
    return chain(
        doubts_of_poses(log),
        doubts_of_units(log),
        doubts_of_surroundings(log),
        doubts_of_times(log),
        doubts_of_duplicates(log),
        doubts_of_motion(log),
        doubts_of_copies(log, log),
    )


def check_log(
    log: BoxLog, place: Path | str, doubts: Iterable[Doubt] | None = None, fix: str = CONVERTED
) -> list[str]:
    """Cautions of implausible values, a line for each check, of all `doubts_of_log` or of some
    `doubts`. Raises InputError for the first that is certain. In `fix`, `{remedy}` is what to
    change."""
    cautions: dict[str, str] = {}
    for doubt in doubts_of_log(log) if doubts is None else doubts:
        error = error_of(doubt, log, place, doubt.column, fix)
        if doubt.certain:
            raise error
        cautions.setdefault(doubt.check, str(error))
    return [*cautions.values()]


def error_of(doubt: Doubt, log: BoxLog, place: Path | str, column: str, fix: str) -> InputError:
    """The line of a doubt; `column` is how the source calls that of the doubt."""
    rows = log.frames if doubt.check in OF_FRAMES else log.boxes
    problem, change = f"{doubt.why}: {doubt.where(rows)}", fix.format(remedy=doubt.remedy)
    return InputError(problem, place=place, key=f"column {column}", fix=change)
