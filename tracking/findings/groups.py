"""Groups of a sweep within which placements can be compared, its rigs and requirements."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import pandas as pd

from lidarplace.requirements.tables import worst_cases
from tracking.labels import detector_label, setting_label
from tracking.run_folders.sweep import RunFolder

EVALUATOR = "evaluator"  # the axis over what evaluates placements
ONE_FOR_ALL = ("generalist", "pretrained")  # evaluators that are one detector for all placements
MOST_NAMES = 24  # of placements in one sentence


@dataclass(frozen=True)
class Group:
    """One detector, "" for surrogates alone, at one setting of the further axes, by key path.

    Attributes:
        detector: name of the detector.
        setting: value of each further axis.
        evaluator: which detector evaluates its placements, see `evaluator` of the configuration.
        varies: whether the sweep has other groups, so that a title must name this one."""

    detector: str
    setting: dict[str, Any]
    evaluator: str
    varies: bool

    @property
    def title(self) -> str:
        """Detector and setting, for example "second, density = 40"."""
        return detector_label(self.setting, self.place)

    @property
    def place(self) -> dict[str, Any]:
        """Detector and setting, by column."""
        return {"detector": self.detector, **self.setting}

    def label(self, name: str) -> str:
        """Add the title to a name where the sweep has other groups."""
        return f"{name} · {self.title}" if self.varies else name

    def includes(self, row: Mapping[str, Any]) -> bool:
        """Tell whether a row with columns of detector and axes belongs to this group."""
        return len(self.of(pd.DataFrame([row]))) == 1

    def of(self, table: pd.DataFrame) -> pd.DataFrame:
        """Select the rows of `table` that belong to this group, by those columns that apply."""
        return at(table, self.place)


def at(table: pd.DataFrame, place: Mapping[Any, Any]) -> pd.DataFrame:
    """Select the rows of `table` with the values of `place`, by those of its columns that apply."""
    for axis, value in place.items():
        if axis in table:
            table = table[table[axis].isna() if pd.isna(value) else table[axis] == value]
    return table


def has_detectors(run: RunFolder) -> bool:
    """Tell whether the sweep trains detectors; there are sweeps of surrogates alone."""
    return bool((run.trials["detector"] != "").any())


def pictured(run: RunFolder) -> str:
    """Name the setting of maps, frames and clouds, "at density = 40"; "" where there is one."""
    values = {a: v for a, v in run.sweep.pictured.items() if a in run.surrogates.columns}
    varied = {a: v for a, v in values.items() if run.surrogates[a].nunique() > 1}
    return f"at {setting_label(varied, varied)}" if varied else ""


def studied(run: RunFolder, table: pd.DataFrame) -> list[str]:
    """Say which placements `table` covers, if these are not all: [] or one sentence."""
    of = set(table["placement"])
    names = [name for name in run.placements if name in of]
    if len(names) == len(run.placements):
        return []
    few = ", ".join(names[:MOST_NAMES]) + (" …" if len(names) > MOST_NAMES else "")
    return [
        f"Computed for {len(names):,} of {len(run.placements):,} placements: {few}. "
        "surrogate.studied_placements sets their number."
    ]


def by_setting(table: pd.DataFrame, axes: Sequence[str]) -> Iterator[tuple[str, pd.DataFrame]]:
    """Split `table` by its further axes, with a title for each part; one part if there are none."""
    columns = [axis for axis in axes if axis in table.columns]
    for values, part in (
        table.groupby(columns, sort=False, dropna=False) if columns else [((), table)]
    ):
        yield setting_label(columns, dict(zip(columns, values, strict=True))), part


def groups(run: RunFolder) -> Iterator[Group]:
    """Yield all groups with a result in the order of results; without any, those of surrogates."""
    table = run.surrogates.assign(detector="") if run.results.empty else run.results
    columns = [axis for axis in run.axes if axis in table.columns]
    places = table[["detector", *columns]].drop_duplicates().to_dict("records")
    for row in places:
        detector = str(row.pop("detector"))
        setting = {str(axis): value for axis, value in row.items()}
        yield Group(
            detector, setting, str(setting.get(EVALUATOR, run.sweep.evaluator)), len(places) > 1
        )


def worst_requirements(run: RunFolder, setting: Mapping[str, object]) -> pd.DataFrame:
    """Find the worst case of each requirement under each placement at one setting of the axes.

    Rows of `lidarplace.requirements.tables.worst_cases`; none if nothing was required."""
    cases = run.requirements
    if cases is None or cases.empty:
        return pd.DataFrame(columns=["placement", "requirement", "met"])
    return worst_cases(at(cases, setting), ["placement"])


def met(verdicts: pd.DataFrame) -> pd.Series:
    """Count the requirements that each placement meets, by its name, such as "3 of 5"."""
    by_rig = verdicts.groupby("placement", sort=False)["met"]
    return by_rig.sum().astype(str) + " of " + by_rig.size().astype(str)


def copies(run: RunFolder) -> dict[str, str]:
    """Map placements with the mounts and the surrogates of an earlier one to that one.

    Equal mounts alone may carry different LiDARs, whose surrogates then differ."""
    first_by_rig: dict[object, str] = {}
    first_by_name = {}
    for name, mounts in run.placements.items():
        of_rig = run.surrogates[run.surrogates["placement"] == name]
        if of_rig.empty:  # its LiDARs are unknown
            continue
        values = of_rig.drop(columns=["placement", "seconds"], errors="ignore").astype(str)
        same = (mounts, tuple(sorted(values.itertuples(index=False, name=None), key=repr)))
        if (first := first_by_rig.setdefault(same, name)) != name:
            first_by_name[name] = first
    return first_by_name


def without(run: RunFolder, names: set[str]) -> RunFolder:
    """Remove placements from a run.

    Equal rigs are no two draws: counted twice they would make a correlation look surer."""
    if not names:
        return run
    trials = run.trials.loc[run.trials["placement"].isin(names), "trial"]
    gone = {"placement": names, "trial": set(trials)}
    tables: dict[str, Any] = {}
    for field in fields(run):
        table = getattr(run, field.name)
        if isinstance(table, pd.DataFrame):
            key = next((key for key in gone if key in table.columns), None)
            if key is not None:
                tables[field.name] = table[~table[key].isin(gone[key])].reset_index(drop=True)
    placements = {name: rig for name, rig in run.placements.items() if name not in names}
    return replace(run, placements=placements, **tables)
