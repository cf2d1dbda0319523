"""What a sweep found, in a few numbers: means over seeds, the summary table."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from tracking.run_folder import RunFolder

KITTI_IOU = {"Car": 0.7}
"""IoU at which KITTI counts a detection as true; 0.5 for the classes not named."""


def headline_iou(results: pd.DataFrame, object_class: str) -> float:
    """KITTI's IoU of the class, or the strictest one evaluated when KITTI's was not."""
    evaluated = results.loc[results["class"] == object_class, "iou"].unique()
    wanted = KITTI_IOU.get(object_class, 0.5)
    return wanted if wanted in evaluated or not len(evaluated) else float(max(evaluated))


def seed_means(results: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """Mean over seeds.

    Returns:
        One row per (placement, class, detector, axes, metric, iou, difficulty): `mean`, `sd`
        (n - 1; NaN for one seed), `seeds`, and the smallest number of `ground_truths`. Rows whose
        value is NaN for every seed have 0 seeds.
    """
    keys = ["placement", "class", "detector", *axes, "metric", "iou", "difficulty"]
    return (
        results.groupby(keys, dropna=False, sort=False, observed=True)
        .agg(
            mean=("value", "mean"),
            sd=("value", "std"),
            seeds=("value", "count"),
            ground_truths=("ground_truths", "min"),
        )
        .reset_index()
    )


def surrogates_of(
    surrogates: pd.DataFrame,
    setting: dict[str, object],
    object_class: str,
    columns: str = "surrogate",
    values: str = "value",
) -> pd.DataFrame:
    """Surrogates of one class at one setting of the axes: placements as rows.

    A missing value in an axis column stands for any value.
    """
    match = surrogates["class"] == object_class
    for axis, value in setting.items():
        if axis in surrogates.columns:
            match &= (surrogates[axis] == value) | surrogates[axis].isna()
    return surrogates[match].pivot(index="placement", columns=columns, values=values)


def summary_table(run: RunFolder) -> pd.DataFrame:
    """A table of a sweep that fits a terminal, best placement first.

    One row per placement, or per (placement, detector, axes) where these vary. Columns: `seeds`;
    S-MIG and expected IG of the first class; `covered entropy`, summed over classes; of the first
    class 3D AP at its KITTI IoU (which orders the rows), its `sd` over seeds, and BEV AP at every
    IoU; BEV AP of the other classes at theirs; `recall` of all objects. Percent, means over seeds.
    A column that the sweep has no number for is left out.
    """
    first, *others = run.classes
    detectors = run.results["detector"].unique()
    varying = [axis for axis in run.axes if run.results[axis].nunique(dropna=False) > 1]
    keys = ["placement", *(["detector"] if len(detectors) > 1 else []), *varying]

    columns: list[tuple[str, str, str, float]] = []
    main_iou = headline_iou(run.results, first)
    columns.append((f"{first} 3D@{main_iou:g}", first, "AP_R40_3D", main_iou))
    for iou in sorted(run.results.loc[run.results["class"] == first, "iou"].unique()):
        columns.append((f"{first} BEV@{iou:g}", first, "AP_R40_BEV", iou))
    for name in others:
        iou = headline_iou(run.results, name)
        columns.append((f"{name} BEV@{iou:g}", name, "AP_R40_BEV", iou))
    iou = headline_iou(run.results, "all")
    columns.append((f"recall@{iou:g}", "all", "recall", iou))

    rows = []
    for key, group in run.results.groupby(keys, dropna=False, sort=False, observed=True):
        row: dict[str, object] = dict(zip(keys, key, strict=True))
        row["seeds"] = group["seed"].nunique()
        setting = {axis: row[axis] for axis in varying}
        own = surrogates_of(run.surrogates, setting, first)
        for title, surrogate in ((f"{first} S-MIG", "s_mig"), (f"{first} E-IG", "expected_ig")):
            if surrogate in own.columns:
                row[title] = own[surrogate].get(row["placement"])
        covered = [surrogates_of(run.surrogates, setting, name) for name in run.classes]
        row["covered entropy"] = sum(
            table["covered_entropy"].get(row["placement"], float("nan")) for table in covered
        )
        for title, name, metric, iou in columns:
            match = (group["class"] == name) & (group["metric"] == metric) & (group["iou"] == iou)
            row[title] = group.loc[match, "value"].mean()
            if title == columns[0][0]:
                row["sd"] = group.loc[match, "value"].std()
        rows.append(row)
    if not rows:
        return pd.DataFrame(columns=[*keys, "seeds"])
    table = pd.DataFrame(rows).dropna(axis="columns", how="all")
    best = columns[0][0]
    if best in table.columns:
        table = table.sort_values(best, ascending=False, kind="stable", na_position="last")
    return table.reset_index(drop=True)
