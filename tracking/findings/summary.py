"""Summary of a sweep in a few numbers: means over seeds, and a table for a terminal."""

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
import pandas as pd
from scipy import stats

from lidarplace.base.metrics import EVERY_IOU, HEADLINE_METRIC, METRICS, RANKING, headline_metric
from lidarplace.pog.surrogates.table import DECIDING, SURROGATES
from tracking.findings.groups import EVALUATOR, ONE_FOR_ALL, met, worst_requirements
from tracking.findings.paired import group_columns, matching
from tracking.kitti_iou import headline_iou
from tracking.labels import in_order, surrogate_short
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.bounded_mean import with_one_at_each_bound
from tracking.statistics.jackknife import by_unit, effective_individuals, error_of_units, largest
from tracking.statistics.reliability import Noise

TERMINAL_ROWS = 20  # rows of the summary of a sweep without results: a terminal shows the best


def seed_means(
    results: pd.DataFrame,
    axes: Sequence[str] = (),
    left_out: pd.DataFrame | None = None,
    evaluator: str = "specialist",
) -> pd.DataFrame:
    """Average results over seeds.

    Its 95 % interval is Student's with the variance over seeds pooled over the placements of the
    same group. With `left_out` the choice of the test objects adds its own variance
    (`tracking.statistics.jackknife`, with one individual more at 0 and at 100,
    `tracking.statistics.bounded_mean`); it is all that the intervals of a single generalist hold.
    `evaluator` is of all results, where it is no axis.

    One row per (placement, class, detector, axes, metric, iou, difficulty): `mean`, `sd`
    (n - 1; NaN for one seed), `seeds` with a value, the smallest number of `ground_truths`;
    `sample_sd`, the error by the choice of the test objects, NaN where it is unknown; `low`
    and `high`, in [0, 100]; and `half`, half the interval of the mean against other placements
    that were tested on the same frames: two of them add in squares. All three are NaN where no
    placement has two seeds, unless a generalist judged them."""
    groups = group_columns(axes)
    means = (
        results.groupby(["placement", *groups], dropna=False, sort=False, observed=True)
        .agg(
            mean=("value", "mean"),
            sd=("value", "std"),
            seeds=("value", "count"),
            ground_truths=("ground_truths", "min"),
        )
        .reset_index()
    )
    errors = _errors(means, left_out, groups, _by_objects)
    seeds = _errors(means, results[results["value"].notna()], groups, _by_seeds)
    sample_sd = np.sqrt(errors["single_variance"])
    centre, errors["single_variance"] = with_one_at_each_bound(
        means["mean"], errors["single_variance"], errors["individuals"].fillna(np.inf), 0.0, 100.0
    )
    counts = means["seeds"].where(means["seeds"] > 0)
    one_for_all = means.get(EVALUATOR, pd.Series(evaluator, means.index)).isin(ONE_FOR_ALL)
    alone = seeds["single_degrees"].isna() & one_for_all
    half = {name: _half(seeds, errors, name, counts, alone) for name in ("single", "paired")}
    return means.assign(
        sample_sd=sample_sd,
        low=(centre - half["single"]).clip(lower=0.0),
        high=(centre + half["single"]).clip(upper=100.0),
        half=half["paired"],
    )


def for_comparison(means: pd.DataFrame) -> pd.DataFrame:
    """Replace the bounds of `seed_means` by those against other placements on the same frames."""
    low = (means["mean"] - means["half"]).clip(lower=0)
    return means.assign(low=low, high=(means["mean"] + means["half"]).clip(upper=100))


def _half(
    seeds: pd.DataFrame, errors: pd.DataFrame, name: str, count: pd.Series, alone: pd.Series
) -> pd.Series:
    """Compute half of Student's 95 % interval for a sum of two variances, by Satterthwaite.

    The variances are of a mean over `count` seeds, and of the test objects; these count alone where
    `alone` is true."""
    other, other_degrees = errors[f"{name}_variance"], errors[f"{name}_degrees"]
    objects_alone = alone & other.notna()
    variance = (seeds[f"{name}_variance"] / count).mask(objects_alone, 0.0)
    degrees = seeds[f"{name}_degrees"].mask(objects_alone, np.inf)
    whole = variance + other.fillna(0)
    parts = variance**2 / degrees + (other**2 / other_degrees).fillna(0)
    freedom = (whole**2 / parts.where(parts > 0)).fillna(degrees)
    half: pd.Series = stats.t.ppf(0.975, freedom) * np.sqrt(whole)
    return half


def _errors(
    means: pd.DataFrame,
    table: pd.DataFrame | None,
    groups: list[str],
    of: Callable[[pd.DataFrame], Iterable[tuple[object, ...]]],
) -> pd.DataFrame:
    """Estimate variance and degrees of freedom of every row of `means`.

    Columns `single_` of a row alone, `paired_` against others; and the number of `individuals`.
    `of` has them of each placement in the rows of a group of `table`; NaN where unknown."""
    names = ["single_variance", "single_degrees", "paired_variance", "paired_degrees"]
    names.append("individuals")
    if table is None or table.empty:
        return pd.DataFrame(np.nan, index=means.index, columns=names)
    keys = [key for key in groups if key in table.columns]
    rows = [
        (*values, *numbers)
        for values, of_group in table.groupby(keys, dropna=False, sort=False, observed=True)
        for numbers in of(of_group)
    ]
    estimates = pd.DataFrame(rows, columns=[*keys, "placement", *names])
    keys.append("placement")
    return means[keys].merge(estimates, on=keys, how="left").set_index(means.index)[names]


def _by_seeds(results: pd.DataFrame) -> Iterator[tuple[object, ...]]:
    """Yield variance and degrees of freedom of one seed's value, alike for all placements."""
    at = [pd.factorize(results[key])[0] for key in ("placement", "seed")]
    y = np.full([numbers.max() + 1 for numbers in at], np.nan)
    y[*at] = results["value"]  # a pivot takes twice as long, for hundreds of groups
    noises = (Noise.of_each(y), Noise.of(y))
    numbers = [value for one in noises for value in (one.variance, one.degrees or np.nan)]
    for placement in results["placement"].unique():
        yield placement, *numbers, np.nan


def _by_objects(left_out: pd.DataFrame) -> Iterator[tuple[object, ...]]:
    units, individuals = [*by_unit(left_out)], effective_individuals(left_out)
    errors = [largest(error_of_units(*each, paired) for each in units) for paired in (False, True)]
    (_, degrees), paired = (
        (np.nan, np.nan) if error is None else (error.variance, error.degrees) for error in errors
    )
    for placement in left_out["placement"].unique():
        single = np.nan if errors[0] is None else errors[0].covariance.at[placement, placement]
        yield placement, single, degrees, *paired, individuals


def surrogates_of(
    surrogates: pd.DataFrame, setting: dict[str, object], object_class: str
) -> pd.DataFrame:
    """Pivot surrogates of one class at one setting of the axes to placements as rows.

    A missing value in an axis column stands for any value."""
    matches = matching(surrogates, {"class": object_class, **setting})
    return matches.pivot(index="placement", columns="surrogate", values="value")


def deciding_surrogate(surrogates: pd.DataFrame) -> str:
    """Choose the surrogate that orders placements without results, the highest first.

    The first computed one of `DECIDING`, which only rise when a LiDAR is added and predict own
    detectors best, or any that was computed."""
    computed = in_order(surrogates.loc[surrogates["value"].notna(), "surrogate"].unique())
    return next((name for name in (*DECIDING, *computed) if name in computed), next(iter(DECIDING)))


def by_surrogate(surrogates: pd.DataFrame) -> list[str]:
    """Sort placements by `deciding_surrogate` over classes and settings, the highest first."""
    deciding = surrogates[surrogates["surrogate"] == deciding_surrogate(surrogates)]
    total = deciding.groupby("placement", sort=False)["value"].sum()
    return [str(name) for name in total.sort_values(ascending=False, kind="stable").index]


def summary_table(run: RunFolder) -> pd.DataFrame:
    """Make a table of a sweep that fits a terminal, best placement first.

    Without results, that of `_surrogate_summary`. Else one row per placement, or per (placement,
    detector, axes) where these vary. Columns: `seeds`; S-MIG and expected IG of the first class;
    `covered entropy`, summed over classes; of the first class 3D AP at its KITTI IoU (which orders
    the rows), its `sd` over seeds, BEV AP at every IoU, 3D AP over IoUs and mean overlap; BEV AP of
    the other classes at their IoU; `recall` of all objects; how many `requirements` are met.
    Percent, means over seeds. A column that the sweep has no number for is left out."""
    if run.results.empty:
        return _surrogate_summary(run)
    first, *others = run.classes
    detectors = run.results["detector"].unique()
    varying = [axis for axis in run.axes if run.results[axis].nunique(dropna=False) > 1]
    keys = ["placement", *(["detector"] if len(detectors) > 1 else []), *varying]
    columns = [_column(first, HEADLINE_METRIC, headline_iou(run.results, first))]
    best = columns[0][0]
    further = [name for name in RANKING if not METRICS[name].headline]
    further_at_iou = [name for name in further if METRICS[name].of_one_iou]
    for iou in sorted(run.results.loc[run.results["class"] == first, "iou"].unique()):
        columns += [_column(first, metric, iou) for metric in further_at_iou]
    columns += [_column(first, name, EVERY_IOU) for name in further if name not in further_at_iou]
    for name in others:
        columns += [
            _column(name, metric, headline_iou(run.results, name)) for metric in further_at_iou
        ]
    columns.append(_column("all", headline_metric("all"), headline_iou(run.results, "all")))

    rows = []
    for key, group in run.results.groupby(keys, dropna=False, sort=False, observed=True):
        row: dict[str, object] = dict(zip(keys, key, strict=True))
        row["seeds"] = group["seed"].nunique()
        setting = {axis: row[axis] for axis in varying}
        by_surrogate_name = surrogates_of(run.surrogates, setting, first)
        for surrogate in ("s_mig", "expected_ig"):
            if surrogate in by_surrogate_name.columns:
                row[f"{first} {surrogate_short(surrogate)}"] = by_surrogate_name[surrogate].get(
                    row["placement"]
                )
        covered = [surrogates_of(run.surrogates, setting, name) for name in run.classes]
        if all("covered_entropy" in table.columns for table in covered):
            row["covered entropy"] = sum(
                table["covered_entropy"].get(row["placement"], float("nan")) for table in covered
            )
        for title, name, metric, iou in columns:
            match = (group["class"] == name) & (group["metric"] == metric) & (group["iou"] == iou)
            row[title] = group.loc[match, "value"].mean()
            if title == best:
                row["sd"] = group.loc[match, "value"].std()
        row["requirements"] = met(worst_requirements(run, setting)).get(row["placement"])
        rows.append(row)
    table = pd.DataFrame(rows).dropna(axis="columns", how="all")
    if best in table.columns:
        table = table.sort_values(best, ascending=False, kind="stable", na_position="last")
    return table.reset_index(drop=True)


def _column(object_class: str, metric: str, iou: float) -> tuple[str, str, str, float]:
    """Return title, class, metric and IoU of a column."""
    of = "" if object_class == "all" else f"{object_class} "
    at = "" if iou == EVERY_IOU else f"@{iou:g}"
    return f"{of}{METRICS[metric].short}{at}", object_class, metric, iou


def _surrogate_summary(run: RunFolder) -> pd.DataFrame:
    """Show the best TERMINAL_ROWS placements of each setting by `deciding_surrogate`.

    With it of every class, if there are several; it, covered entropy and S-MIG over classes."""
    order = by_surrogate(run.surrogates)
    if not order:
        return pd.DataFrame(columns=["placement"])
    decides = deciding_surrogate(run.surrogates)
    known_axes = [axis for axis in run.axes if axis in run.surrogates.columns]
    varying = [axis for axis in known_axes if run.surrogates[axis].nunique() > 1]
    settings = run.surrogates[varying].drop_duplicates().to_dict("records") if varying else [{}]
    tables = []
    for row in settings:
        setting = {str(axis): value for axis, value in row.items()}
        by_class = {name: surrogates_of(run.surrogates, setting, name) for name in run.classes}
        columns = {"placement": pd.Series(order, index=order)}
        columns |= {axis: pd.Series(value, index=order) for axis, value in setting.items()}
        for surrogate in dict.fromkeys((decides, "covered_entropy", "s_mig")):
            values_by_class = {
                k: table[surrogate] for k, table in by_class.items() if surrogate in table.columns
            }
            title = surrogate_short(surrogate)
            if surrogate == decides and len(run.classes) > 1:
                columns |= {f"{name} {title}": values for name, values in values_by_class.items()}
            of_classes = pd.DataFrame(values_by_class, index=order)
            total = of_classes.sum(axis=1, min_count=1)
            columns[title] = of_classes.mean(axis=1) if SURROGATES[surrogate].of_objects else total
        columns["requirements"] = met(worst_requirements(run, setting)).reindex(order)
        table = pd.DataFrame(columns).dropna(axis="columns", how="all")
        table = table.sort_values(surrogate_short(decides), ascending=False, kind="stable")
        tables.append(table.head(TERMINAL_ROWS))
    return pd.concat(tables, ignore_index=True)
