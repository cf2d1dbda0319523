"""Weaknesses of the evidence in a comparison of placements, and what to run against them."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from lidarplace.base.metrics import HEADLINE_METRIC
from lidarplace.command_line.invocation import with_settings
from lidarplace.configuration.renamed_keys import with_current_keys
from lidarplace.configuration.yaml import parse_yaml
from lidarplace.pog.surrogates.evaluate import MOSTLY_LINEAR
from tracking.findings.groups import EVALUATOR, ONE_FOR_ALL, Group
from tracking.findings.individuals import MOST_FREQUENT, count_individuals
from tracking.kitti_iou import at_headline_iou, headline_iou
from tracking.labels import metric_label, some
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.jackknife import LEAST_ROUTES

LEAST_SEEDS = 3
"""Least number of seeds: two scatter by a single difference, which says little of the next one."""
LEAST_INDIVIDUALS = 100
"""Least number of individuals of a class in the test frames.

If an individual is found in all of its frames or in none, the chance of which ones were met moves
a recall of 50 % by 10 points to either side (95 %) with 100 of them, and by 17 with 34."""
LEAST_AP = 5.0
"""Percent of the headline's AP; below it everywhere, differences between placements say nothing."""
STILL_FALLING = 0.05  # share of the loss of the epoch before that the last epoch still took off
MOST_TIMES = 10.0  # a training is not suggested to be longer by more


@dataclass(frozen=True)
class Weakness:
    """Reason why a comparison of placements is not sufficient evidence.

    Attributes:
        kind: what is lacking, a word.
        classes: whose headlines it weakens; "all" is that of the recall of all objects.
        clause, sentence: what is lacking, for a headline; and what follows, for a list.
        shortfall: how many times as much it takes, above 1.
        remedy: key path of the configuration -> value that removes it."""

    kind: str
    classes: tuple[str, ...]
    clause: str
    sentence: str
    shortfall: float
    remedy: Mapping[str, Any]


def weaknesses(run: RunFolder, group: Group) -> list[Weakness]:
    """List the weaknesses of the headlines of a group, the heaviest first."""
    kinds = (_few_seeds, _few_test_objects, _learned_little, _short_training)
    every = [weakness for find in kinds for weakness in find(run, group)]
    return sorted(every, key=lambda weakness: -weakness.shortfall)


def grade(weaknesses: Iterable[Weakness]) -> str:
    """Grade the evidence by its weaknesses, a sentence; "" without any."""
    reasons = heaviest(weaknesses)
    return f"Not enough evidence: {reasons}." if reasons else ""


def heaviest(weaknesses: Iterable[Weakness]) -> str:
    """Name the two kinds of weaknesses that weigh most; "" without any."""
    worst: dict[str, str] = {}
    for weakness in sorted(weaknesses, key=lambda weakness: -weakness.shortfall):
        worst.setdefault(weakness.kind, weakness.clause)
    return " and ".join([*worst.values()][:2])


def remedy(command: str, weaknesses: Sequence[Weakness]) -> str:
    """Add keys that remove weaknesses to the line that ran the sweep or search; "" without any."""
    keys = dict.fromkeys(key for weakness in weaknesses for key in weakness.remedy)
    most = {
        key: max(weakness.remedy[key] for weakness in weaknesses if key in weakness.remedy)
        for key in keys
    }
    return with_settings(command, most) if most else ""


def value_at(config: str, *keys: str) -> Any:
    """Look up the value below these keys of a configuration in YAML; None if there is none.

    Raises YamlError."""
    value = parse_yaml(config)
    for key in keys:
        value = with_current_keys(value).get(key) if isinstance(value, dict) else None
    return value


def few_seeds(
    seeds: Mapping[str, set[int]], generalist: bool, key: str, classes: tuple[str, ...] = ()
) -> list[Weakness]:
    """Report placements that fewer seeds than `LEAST_SEEDS` judged; [] if there are none.

    `seeds` are by placement. `generalist`: a seed is one detector for all placements; `key` is the
    path of the configuration."""
    fewest = min(map(len, seeds.values()), default=LEAST_SEEDS)
    if fewest >= LEAST_SEEDS:
        return []
    one = "generalist" if generalist else "seed"
    few = [name for name, numbers in seeds.items() if len(numbers) == fewest]
    of = "" if len(few) == len(seeds) else f" only for {some(few)}"
    consequence = {
        (1, False): f"One seed{of}: differences between placements may be training noise.",
        (1, True): f"One generalist{of}: another one may rank the placements differently; no "
        "interval has that.",
    }.get((fewest, generalist), f"Two {one}s{of}: the spread over {one}s is itself uncertain.")
    every_seed = sorted(set().union(*seeds.values()))
    more = range(max(every_seed) + 1, max(every_seed) + LEAST_SEEDS)
    return [
        Weakness(
            "seeds",
            classes,
            f"only {fewest} {one}{'s' * (fewest > 1)} (at least {LEAST_SEEDS})",
            consequence,
            LEAST_SEEDS / fewest,
            {key: [*every_seed, *more][: max(LEAST_SEEDS, len(every_seed))]},
        )
    ]


def _few_seeds(run: RunFolder, group: Group) -> list[Weakness]:
    values = group.of(run.results).dropna(subset=["value"])
    by_rig = values.groupby("placement", sort=False)["seed"]
    seeds = {str(name): set(numbers) for name, numbers in by_rig}
    few = few_seeds(seeds, group.evaluator in ONE_FOR_ALL, "grid.seed", (*run.classes, "all"))
    evaluators = [value_at(run.config, EVALUATOR), *(value_at(run.config, "grid", EVALUATOR) or ())]
    commands = {
        settings.get("name", "command"): settings.get("command", "")
        for settings in evaluators
        if isinstance(settings, dict)
    }
    if "{seed}" not in commands.get(group.evaluator, "{seed}"):  # evaluated only once
        more = " Name {seed} in evaluator.command to train it again."
        few = [replace(weakness, sentence=weakness.sentence + more, remedy={}) for weakness in few]
    # There is one pretrained generalist; generalists of the sweep's own can be several.
    if group.evaluator == ONE_FOR_ALL[1]:
        generalists = _set(run, EVALUATOR, ONE_FOR_ALL[0])
        few = [replace(weakness, remedy={**generalists, **weakness.remedy}) for weakness in few]
    return few


def _few_test_objects(run: RunFolder, group: Group) -> Iterator[Weakness]:
    """Report few individuals or routes in the test frames, or an unknown number."""
    if run.left_out is None:
        yield Weakness(
            "unknown",
            (*run.classes, "all"),
            "intervals over seeds alone: left_out.parquet, with the test objects, is missing",
            "Intervals are over seeds alone, as if these were the only test objects: the run "
            "folder has no left_out.parquet, which earlier versions did not write. The sweep's "
            "command makes it.",
            math.inf,
            {},
        )
    if run.individuals is None:
        return
    test = group.of(run.individuals[run.individuals["split"] == "test"])
    every = pd.concat([test, test.assign(**{"class": "all"})])
    counts = count_individuals(every).set_index("class")
    routes = len(test[["scene", "route"]].drop_duplicates())
    few = counts.index[counts["routes"] < LEAST_ROUTES].drop("all", errors="ignore")
    longer = " Name a longer log as scene.test_folder." if _tests_on_a_log(run) else ""
    for name, row in counts.loc[counts.index.isin([*run.classes, "all"])].iterrows():
        met, driven = row["individuals"], row["routes"]
        of, several = "" if name == "all" else f" of {name}", f"individual{'s' * (met != 1)}"
        if met < LEAST_INDIVIDUALS:
            ten = f", {MOST_FREQUENT} of which have {100 * row['share_of_ten']:.0f} % of the boxes"
            yield Weakness(
                "individuals",
                (str(name),),
                f"only {met} {several}{of} in the test frames (at least {LEAST_INDIVIDUALS})",
                f"{name}: {row['boxes']:,} test boxes are {met} {several}"
                f"{ten if met > MOST_FREQUENT else ''}: others may give another AP.{longer}",
                LEAST_INDIVIDUALS / met,
                _more_routes(run, routes, LEAST_INDIVIDUALS / met),
            )
        if driven < LEAST_ROUTES:
            yield Weakness(
                "routes",
                (str(name),),
                f"only {driven} test route{'s' * (driven != 1)}"
                f"{of and f' with {name}'} (at least {LEAST_ROUTES})",
                f"Fewer than {LEAST_ROUTES} test routes with {', '.join(few)}: intervals "
                f"include the choice of individuals, not how routes differ.{longer}",
                LEAST_ROUTES / driven,
                _more_routes(run, routes, LEAST_ROUTES / driven),
            )


def _learned_little(run: RunFolder, group: Group) -> Iterator[Weakness]:
    for name in run.classes:
        of_class = at_headline_iou(group.of(run.results), run.results, name)
        most = of_class.groupby("placement")["value"].mean().max()
        if most < LEAST_AP:
            metric = metric_label(HEADLINE_METRIC, headline_iou(run.results, name))
            times = LEAST_AP / most if most > 0 else math.inf
            yield Weakness(
                "learned",
                (name, "all"),
                f"a detector that learned little ({metric} of {name} is at most {most:.1f} %)",
                f"{name}: {metric} is below {LEAST_AP:g} % everywhere: the detector learned too "
                "little.",
                times,
                _longer(run, group, times),
            )


def _short_training(run: RunFolder, group: Group) -> Iterator[Weakness]:
    """Report trainings that were still learning when they ended: longer ones may rank otherwise."""
    loss = _losses(run, group)
    ends = [of_trial["value"].tolist()[-2:] for _, of_trial in loss.groupby("trial", sort=False)]
    fell = [1 - end[1] / end[0] for end in ends if len(end) == 2 and end[0] > 0]
    still = [share for share in fell if share > STILL_FALLING]
    if still:
        took = sum(still) / len(still)
        of = "" if len(still) == len(fell) else f" of {len(still)} of {len(fell)} trials"
        yield Weakness(
            "training",
            (*run.classes, "all"),
            f"a short training (the last epoch{of} still lowered the loss by {100 * took:.0f} %)",
            f"Training was short: in {len(still)} of {len(fell)} trials the last epoch still "
            f"lowered the loss by more than {100 * STILL_FALLING:g} %. A longer training may rank "
            "differently.",
            took / STILL_FALLING,
            # Of a loss that falls with a power of the epochs, an epoch takes a share of 1 / epochs.
            _longer(run, group, took / STILL_FALLING),
        )


def _losses(run: RunFolder, group: Group) -> pd.DataFrame:
    """Select the losses by trial and epoch; none where the curves are not known."""
    if run.curves is None or run.curves.empty:
        return pd.DataFrame(columns=["trial", "epoch", "value"])
    trials = group.of(run.trials)["trial"]
    losses = run.curves[(run.curves["metric"] == "loss") & run.curves["trial"].isin(trials)]
    return losses.sort_values("epoch")


def _longer(run: RunFolder, group: Group, times: float) -> dict[str, Any]:
    epochs = _losses(run, group)["epoch"].max()
    key = "generalist.epochs" if group.evaluator in ONE_FOR_ALL else "training.epochs"
    most = min(max(times, 2.0), MOST_TIMES)
    return {} if pd.isna(epochs) else _set(run, key, math.ceil(epochs * most))


def _more_routes(run: RunFolder, routes: int, times: float) -> dict[str, Any]:
    """Return the setting for `times` as many test routes, at least twice `LEAST_ROUTES`.

    Empty for a log: nobody knows the name of a longer one."""
    if _tests_on_a_log(run):
        return {}
    return _set(run, "scene.test_routes", max(2 * LEAST_ROUTES, math.ceil(routes * times)))


def _tests_on_a_log(run: RunFolder) -> bool:
    return bool(value_at(run.config, "scene", "source") == "log")


def _set(run: RunFolder, key: str, value: int | str) -> dict[str, Any]:
    """Set a key, or the axis of the grid that it is."""
    return {f"grid.{key}": [value]} if key in run.axes else {key: value}


def ray_counting_caution(share: float) -> list[str]:
    """Warn if `expected_ig` of this `linear_share` mostly counts rays: [] or a sentence."""
    if not share > MOSTLY_LINEAR:
        return []
    return [
        f"Expected IG counts rays here: it is {100 * share:.0f} % of what it would be if every "
        "ray counted by itself, so a ray through voxels that others have seen is worth as much as "
        "one through new ones. More lidar.azimuth_steps (lidar.cloud_share thins the clouds alone),"
        " a greater surrogate.detection_probability or a coarser surrogate.resolution change that."
    ]


def largest_linear_share(surrogates: pd.DataFrame) -> float:
    """Return the largest `linear_share` of `surrogates.parquet`.

    NaN if there is no `expected_ig`, and of older run folders."""
    return float(surrogates.get("linear_share", pd.Series(dtype="float64")).max())
