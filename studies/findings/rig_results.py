"""Numbers of one set of rigs as the words of the page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from combining import Combination, combined
from predicting import (
    PREDICTORS,
    behind,
    best,
    coefficients,
    every_predictor,
    most,
    named,
    of,
    own_detectors,
    regret,
)

from tracking.findings.best_placement import BestPlacement
from tracking.labels import surrogate_name
from tracking.report.sections.regret import AT_RANDOM

SHORT = {
    "car07": ("Car", "AP_R40_3D", 0.7),
    "car05": ("Car", "AP_R40_3D", 0.5),
    "car": ("Car", "AP_R40_3D_mean", 0.0),
    "car_recall": ("Car", "class_recall_3D", 0.5),
    "pedestrian": ("Pedestrian", "AP_R40_3D", 0.5),
    "pedestrian_recall": ("Pedestrian", "class_recall_3D", 0.5),
    "cyclist": ("Cyclist", "AP_R40_3D", 0.5),
    "cyclist_recall": ("Cyclist", "class_recall_3D", 0.5),
    "recall": ("all", "recall", 0.5),
}
"""The targets by the words of the page."""
HEADS = (
    "Car AP @ 0.7",
    "Car AP @ 0.5",
    "Car AP over IoU",
    "Car recall",
    "Ped. AP",
    "Ped. recall",
    "Cyc. AP",
    "Cyc. recall",
    "recall of all",
)
_NAMES = {
    "generalist": "**generalist** (three, same metric)",
    "expected_ig, occluded": "expected IG, occluded",
}


def label(predictor: str) -> str:
    """Display name."""
    return _NAMES.get(predictor, surrogate_name(predictor))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown; the first column is words, the others are numbers."""
    lines = [" | ".join(head), " | ".join(["---", *["---:"] * (len(head) - 1)])]
    return "\n".join(f"| {line} |" for line in [*lines, *(" | ".join(row) for row in rows)])


def head_of(target: str) -> str:
    """What a column of a target is called."""
    return HEADS[list(SHORT).index(target)]


def spread(row: pd.Series) -> str:
    """Interval of a difference in points."""
    return f"{number(row['low'], 1, sign=True)} to {number(row['high'], 1, sign=True)}"


def led(row: pd.Series) -> str:
    """A difference in points, and its interval."""
    return f"{number(row['difference'], 1, sign=True)} ({spread(row)})"


def beside_table(
    heads: Sequence[str],
    rigs: Mapping[str, Sequence[str]],
    best: Mapping[str, BestPlacement],
    reference: str,
    called: str,
) -> str:
    """What rigs reach, and the intervals of their differences to one of them.

    Args:
        heads: of the first columns.
        rigs: the first cells, by rig.
        best: by target.
        reference: a rig.
        called: the reference, in the heads.
    """
    columns = []
    for found in best.values():
        means = dict(zip(found.sure.index, found.means, strict=True))
        leads = found.differences(reference)
        columns.append([number(means[rig], 1) for rig in rigs])
        columns.append(["" if rig == reference else spread(leads.loc[rig]) for rig in rigs])
    cells = zip(rigs.values(), *columns, strict=True)
    told = [part for target in best for part in (head_of(target), f"less {called}")]
    return table([*heads, *told], [[*first, *others] for first, *others in cells])


def number(value: float, digits: int = 2, sign: bool = False) -> str:
    """Rounded, with a minus that is one; a dash where it is unknown."""
    if not np.isfinite(value):
        return "–"
    return f"{value:{'+' if sign else ''}z.{digits}f}".replace("-", "−")


@dataclass(frozen=True)
class RigResults:
    """Rigs with detectors of their own, and what was said of them before.

    Attributes:
        rigs: their names.
    """

    rigs: Sequence[str]

    @cached_property
    def results(self) -> pd.DataFrame:
        """Rows of the rigs' own detectors."""
        return own_detectors(self.rigs)

    @cached_property
    def coefficients(self) -> pd.DataFrame:
        """`predicting.coefficients` of these rigs."""
        return coefficients(self.results)

    @cached_property
    def ceilings(self) -> pd.DataFrame:
        """`predicting.most` of these rigs."""
        return most(self.results)

    def means(self, target: str) -> pd.Series:
        """Over seeds, by rig, the best first."""
        rows = of(self.results, SHORT[target])
        return rows.groupby("placement")["value"].mean().sort_values(ascending=False)

    def best(self, target: str) -> BestPlacement:
        """Rigs against each other."""
        return best(self.results, SHORT[target])

    def row(self, predictor: str, target: str) -> pd.Series:
        """Of `coefficients`; NaN where the predictor has no value for the target."""
        key = (predictor, named(SHORT[target]))
        if key not in self.coefficients.index:
            return pd.Series(np.nan, ["spearman", "spearman_low", "spearman_high"])
        return self.coefficients.loc[key]

    def rho(self, predictor: str, target: str) -> str:
        """Spearman's."""
        return number(self.row(predictor, target)["spearman"])

    def interval(self, predictor: str, target: str) -> str:
        """Spearman's rho with 95 %."""
        row = self.row(predictor, target)
        low, high = row["spearman_low"], row["spearman_high"]
        return f"{number(row['spearman'])} ({number(low)} to {number(high)})"

    def ceiling(self, target: str) -> str:
        """What a perfect predictor is expected to reach, by seeds and test objects."""
        return number(self.ceilings.loc[named(SHORT[target]), "ceiling"])

    def seeds_agree(self, target: str) -> str:
        """Two seeds of the same rig."""
        return number(self.ceilings.loc[named(SHORT[target]), "agreement_of_seeds"])

    def rho_table(self) -> str:
        """A row a predictor, then the ceilings."""
        rows = [[label(name), *(self.rho(name, target) for target in SHORT)] for name in PREDICTORS]
        rows.append(["two seeds agree (ICC)", *map(self.seeds_agree, SHORT)])
        rows.append(["*ceiling of ρ*", *map(self.ceiling, SHORT)])
        return table(["", *HEADS], rows)

    def interval_table(self, *targets: str) -> str:
        """Few targets, with intervals, and whether a predictor is told from the generalist."""
        head = [""]
        for target in targets:
            head += [head_of(target), "generalist's lead in \\|ρ\\|"]
        leads = {target: behind(self.results, SHORT[target]) for target in targets}
        rows = []
        for name in PREDICTORS:
            cells = [label(name)]
            for target in targets:
                lead = leads[target]
                own = lead.loc[name] if name in lead.index else None
                apart = "" if own is None else f"{number(own['low'])} to {number(own['high'])}"
                cells += [self.interval(name, target), apart]
            rows.append(cells)
        return table(head, rows)

    def regret_table(self, *targets: str) -> str:
        """What is lost by taking the rig that a predictor puts first, in points."""
        lost = {target: regret(self.results, SHORT[target]) for target in targets}
        rows = []
        for name in (*PREDICTORS, AT_RANDOM):
            cells = [label(name)]
            for target in targets:
                own = lost[target]
                row = own.loc[name] if name in own.index else None
                cells += ["–", "–"] if row is None else [str(row["choice"]), _lost(row)]
            rows.append(cells)
        heads = [head_of(target) for target in targets]
        return table(["", *(part for head in heads for part in (f"{head}: takes", "loses"))], rows)

    def combination(self, target: str, terms: int) -> Combination:
        """Of all predictors that need no detector."""
        x, y = self._known(target)
        return combined(x, y, terms)

    def _known(self, target: str) -> tuple[pd.DataFrame, pd.Series]:
        wide = every_predictor(SHORT[target])
        y = self.means(target)
        free = [name for name in PREDICTORS if name in wide.columns and name != "generalist"]
        # IG is what covered entropy leaves: the same column.
        x = wide.loc[y.index, [name for name in free if name != "ig"]]
        return x, y


def _lost(row: pd.Series) -> str:
    return f"{number(row['regret'], 1)} ({number(row['low'], 1)} to {number(row['high'], 1)})"
