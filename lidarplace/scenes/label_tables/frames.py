"""Frames from time stamps, routes and splits from recordings."""

from contextlib import suppress
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import percent
from lidarplace.base.ranges import FRAMES
from lidarplace.files.columns import check_values, integers, numbers, row_name, texts
from lidarplace.logs.boxes import first
from lidarplace.scenes.label_tables.mapping import TableMapping
from lidarplace.scenes.label_tables.units import SECONDS, TimeUnit

OFF_GRID = 0.25  # by so much of a frame's duration may time stamps differ from an even rate
DRIVE = "log"  # scene of a file that has no column of drives


class Stamps(NamedTuple):
    """Drive and time of each row: its name, and the file's own unit; both (rows,).

    Doubles hold microseconds of our epoch exactly, nanoseconds to a quarter of a microsecond."""

    drive: NDArray[np.object_]
    value: NDArray[np.float64]


def read_stamps(
    table: pd.DataFrame, drive: str | None, stamp: str, unit: TimeUnit | None, source: str
) -> Stamps:
    """Read drive and time of every row, or its frame number without a `unit`.

    Dates become microseconds since 1970. Raises ValueError for values that are none."""
    names = np.full(len(table), DRIVE, object) if drive is None else texts(table, drive, source)
    if unit is None:
        return Stamps(names, integers(table, stamp, source).astype(np.float64))
    dates = pd.Series(pd.NaT, index=table.index)
    if unit == "iso" or not pd.api.types.is_numeric_dtype(table[stamp]):
        dates = read_dates(table[stamp])
    if unit == "iso":
        check_values(table, [stamp], dates.isna(), "a date of ISO 8601", source)
        epoch = pd.Timestamp(0, tz="UTC")
        microseconds = (dates - epoch) / pd.Timedelta("1us")
        return Stamps(names, np.asarray(microseconds.to_numpy(np.float64)))
    if (row := first(dates.notna().to_numpy())) is not None:
        found, expected = str(table[stamp].iloc[row]), f"numbers, as units.time is {unit}"
        where = {"place": f"{source}: {row_name(table, row)}", "key": stamp, "found": found}
        raise InputError("a date", **where, expected=expected, fix="write `units: {time: iso}`")
    return Stamps(names, numbers(table, [stamp], source)[:, 0])


def read_dates(column: pd.Series) -> pd.Series:
    """Return dates of ISO 8601 with any zone, UTC without one; NaT where a value is none."""
    dates = column.where(column.map(lambda value: isinstance(value, str | datetime)))
    return pd.to_datetime(dates.map(_date), utc=True, errors="coerce")


def _date(value: object) -> datetime | None:
    with suppress(ValueError, TypeError, OverflowError):
        date = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
        return date if date.tzinfo else date.replace(tzinfo=UTC)
    return None


def frames_of(
    stamps: Stamps, mapping: TableMapping, source: str
) -> tuple[pd.DataFrame, NDArray[np.int64]]:
    """Make the table of frames, and return it with the frame number of every row.

    Frames have `FRAME_COLUMNS`, and `stamp` in the file's own unit. Numbers count through the
    drives in the order of their names. Raises ValueError if time stamps do not keep the rate, or a
    drive of the mapping is not there."""
    drives, route = np.unique(stamps.drive.astype(str), return_inverse=True)
    split = _splits(drives, mapping, source)
    of_row = np.zeros(len(route), np.int64)
    tables: list[pd.DataFrame] = []
    first = 0
    for number, drive in enumerate(drives):
        of_drive = route == number
        values, index = _frames_of_drive(stamps.value[of_drive], mapping, source)
        of_row[of_drive] = first + index
        seconds = (values - values[0]) / (mapping.frames.rate_hz or np.nan)
        if mapping.columns.time is not None:
            seconds = (values - values[0]) * SECONDS[mapping.units.time]
        table = {"scene": drive, "frame": first + np.arange(len(values)), "route": number}
        time = {"timestamp_s": seconds, "stamp": values}
        tables.append(pd.DataFrame({**table, **time, "split": split[drive]}))
        first += len(values)
    return pd.concat(tables, ignore_index=True), of_row


def _frames_of_drive(
    value: NDArray[np.float64], mapping: TableMapping, source: str
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return stamps of the frames of one drive, and which of them each row is in."""
    rate = mapping.frames.rate_hz
    times, of_row = np.unique(value, return_inverse=True)
    if rate is None:
        return times, of_row.astype(np.int64)
    a_frame = 1.0 if mapping.columns.time is None else 1 / (rate * SECONDS[mapping.units.time])
    if (most := (times[-1] - times[0]) / a_frame) >= FRAMES.high:
        problem, expected = f"a drive at {rate:g} Hz", f"at most {FRAMES.high:,} frames"
        parts = {"found": f"{most:,.0f}", "fix": "change units.time or frames.rate_hz"}
        raise InputError(problem, place=source, key=mapping.stamp, expected=expected, **parts)
    number, off = np.zeros(len(times), np.int64), np.zeros(len(times), bool)
    last, count = times[0], 0
    for i, time in enumerate(times):  # from the frame before, not the first: a clock drifts
        steps = (time - last) / a_frame
        off[i] = abs(steps - round(steps)) > OFF_GRID
        if whole := round(steps):
            last, count = time, count + whole
        number[i] = count
    if off.any():
        problem = f"{percent(off[of_row].mean(), '.1f')} of the rows of a drive are more than a "
        problem += f"quarter of a frame off a rate of {rate:g} Hz, "
        problem += f"the first with {times[np.argmax(off)]:.16g}"
        fix = "change frames.rate_hz or units.time"
        raise InputError(problem, place=source, key=mapping.stamp, fix=fix)
    labelled, first = np.unique(number, return_index=True)
    return np.interp(np.arange(labelled[-1] + 1), labelled, times[first]), number[of_row]


def _splits(drives: NDArray[np.str_], mapping: TableMapping, source: str) -> dict[str, str]:
    train, test = mapping.drives.train, mapping.drives.test
    for key, names in (("train", train or ()), ("test", test)):
        if missing := [name for name in names if name not in drives]:
            listed = ", ".join(drives[:20]) + (" …" if len(drives) > 20 else "")
            problem = f"no drive {missing[0]!r} in column {mapping.columns.drive}"
            raise InputError(problem, place=source, key=f"drives.{key}", found=listed)
    split = {str(drive): "test" if drive in test else "train" for drive in drives}
    if left := [name for name in split if train is not None and name not in (*train, *test)]:
        problem = f"{left[0]!r} is neither in train nor in test, nor are {len(left) - 1} others"
        fix = "leave train out to take all that are not test"
        raise InputError(problem, place=source, key="drives", fix=fix)
    return split
