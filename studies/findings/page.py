"""Writes `docs/findings.md`, `docs/findings_tables.md` and a figure from the tables.

Run as `python studies/findings/page.py`. The words are those of `page.md` and `tables.md`, whose
numbers are all looked up here.
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[1] / "proof"))

import contrast
import controlled_table
import exact
import lidars
import otherwise
import pandas as pd
import population
import products_table
import riddle_table
import shuttle_table
from aside import aside_table, errors_table
from candidates import FOLDER
from combining import shares
from figures import write_figure
from fitted import fitted_table
from jinja2 import Environment, StrictUndefined
from predicting import equal_budget, every_predictor, own_detectors, read, set_aside
from properties import properties
from rig_results import SHORT, RigResults, beside_table, head_of, label, number, table

DOCS = FOLDER.parents[1] / "docs"
OPTIMA = (
    "generalist",
    "expected_recall",
    "expected_ig",
    "covered_entropy",
    "expected_points",
    "m_sog",
)
"""Objectives by which a rig was searched for."""
NETWORKS = {
    "finetuned": "`pointpillars_tiny`, fine-tuned",
    "scratch": "`pointpillars_tiny`, from scratch",
    "second_tiny": "`second_tiny`, from scratch",
    "pointpillars": "`pointpillars_paper`, from scratch",
}
TESTS = {
    None: "all three tests",
    "generated": "generated town",
    "sparse": "half the traffic",
    "carla": "CARLA's map",
}
"""Of the proof, by what its tables call them; None: the mean."""
BOUGHT = {
    "bought": ("`puck_hires`, two `xt32`", 15_314),
    "bought_three": ("three `puck_hires`", 12_000),
    "bought_cheap": ("two `puck_hires`", 8_000),
    "three_hires": ("three `puck_hires`, a plain stack", 12_000),
}
"""Rigs for at most the price of four `vlp16`, US dollars."""
BOUGHT_NETWORKS = {"bought_finetuned": "fine-tuned", "bought_scratch": "from scratch"}
"""Detectors of these rigs, by what the tables call them."""
REFERENCE = "center"
"""The best of the paper's eight."""


PAGES = {"findings.md": "page.md", "findings_tables.md": "tables.md"}
"""Template by page."""


def main() -> None:
    """Write pages and figure."""
    for page in PAGES:
        (DOCS / page).write_text(rendered(page), encoding="utf-8")
    write_figure(_four(), DOCS / "findings.png")


def rendered(page: str) -> str:
    """A page as text."""
    environment = Environment(undefined=StrictUndefined, keep_trailing_newline=True)
    template = environment.from_string((FOLDER / PAGES[page]).read_text(encoding="utf-8"))
    return "\n\n".join(map(_wrapped, template.render(_facts()).strip().split("\n\n"))) + "\n"


def _wrapped(block: str) -> str:
    """A paragraph or list in lines of even length, which looked-up numbers have not."""
    if block.lstrip().startswith(("|", "#", "!")):
        return block
    items = re.split(r"\n(?=- )", block)
    return "\n".join(
        textwrap.fill(
            " ".join(item.split()),
            100,
            subsequent_indent="  " if item.startswith("- ") else "",
            break_long_words=False,
            break_on_hyphens=False,
        )
        for item in items
    )


def _facts() -> dict[str, Any]:
    """What the words may use, by name."""
    every, aside = RigResults(_trained()), RigResults(set_aside())
    typical = [name for name in _four().rigs if name != "optimum_m_sog"]
    return {
        "every": every,
        "four": _four(),
        "typical": RigResults(typical),
        "aside": aside,
        "aside_four": RigResults(equal_budget(set_aside())),
        "whole": RigResults(equal_budget([*every.rigs, *aside.rigs])),
        "aside_table": aside_table(every, aside),
        "errors_table": errors_table(every, aside),
        "fitted_table": fitted_table(RigResults(typical)),
        "controlled": controlled_table,
        "exact": exact,
        "otherwise": otherwise,
        "riddle": riddle_table,
        "lidars": lidars,
        "reference": REFERENCE,
        "optima_table": _optima_table(),
        "combination_table": _combination_table(_four()),
        "shares_table": _shares_table(_four()),
        "number": number,
        "products": products_table,
        "counts": _counts(),
        "hours": _hours(),
        "population": population,
        "old": population.OLD,
        "new": population.NEW,
        "proof": contrast,
        "upright": contrast.PAIRS[1],
        "lower": contrast.PAIRS[2],
        "two": contrast.PAIRS[3],
        "proof_table": _proof_table,
        "shuttle": shuttle_table,
        "price_table": _price_table,
        "hires": contrast.PAIRS[8],
        "proof_cars": contrast.individuals("Car"),
    }


def _trained() -> list[str]:
    return [str(name) for name in own_detectors()["placement"].unique()]


@cache
def _four() -> RigResults:
    """The rigs of the same LiDARs."""
    return RigResults(equal_budget(_trained()))


def _counts() -> dict[str, int]:
    """Of the test frames, and of what was trained."""
    individuals = read("individuals").query("split == 'test'")
    results = read("main_results")
    own = own_detectors()
    return {
        "boxes": int(individuals["boxes"].sum()),
        "individuals": len(individuals),
        "cars": int((individuals["class"] == "Car").sum()),
        "routes": individuals["route"].nunique(),
        "trainings": len(own[["placement", "seed"]].drop_duplicates()),
        "seeds": own["seed"].nunique(),
        "generalists": results.loc[results["evaluator"] == "generalist", "seed"].nunique(),
    }


def _hours() -> pd.Series:
    """Of tasks, by stage; of all that makes clouds together."""
    hours = read("hours").set_index("stage")["hours"]
    simulated = ["scene", "collect", "ground_truth"]
    return pd.concat([hours.drop(simulated), pd.Series({"simulated": hours[simulated].sum()})])


def _proof_table(*tests: str | None) -> str:
    """The contrast of the proof, a row a network and test of TESTS."""
    metrics = ("Car AP over IoU", "Car recall", "Pedestrian recall", "Cyclist recall")
    metrics = (*metrics, "recall of all")
    known = set(contrast.read()["network"])
    rows = [
        [f"{words}, {TESTS[test]}", *(contrast.gain(network, m, test=test) for m in metrics)]
        for network, words in NETWORKS.items()
        if network in known
        for test in tests
    ]
    return table(["*found* less *center*, points, 95 %", *metrics], rows)


def _price_table(metrics: Sequence[str]) -> str:
    """What rigs of the same price or less gain over four plain `vlp16`, a row a rig."""
    asked = [(network, metric) for network in BOUGHT_NETWORKS for metric in metrics]
    rows = []
    for rig, (models, price) in BOUGHT.items():
        gains = (
            contrast.gain(network, metric, pair=(rig, "four_stack"))
            if contrast.has(network, rig)
            else "–"
            for network, metric in asked
        )
        rows.append([f"`{rig}`: {models}", f"{price:,}", *gains])
    heads = [f"{metric}, {BOUGHT_NETWORKS[network]}" for network, metric in asked]
    return table(["less four `vlp16`, points, 95 %", "US dollars", *heads], rows)


def _optima_table() -> str:
    """The rig that each objective's search found: what its own detectors reach."""
    targets = ("car07", "car", "recall")
    found = RigResults([*(f"optimum_{one}" for one in OPTIMA), REFERENCE])
    best = {target: found.best(target) for target in targets}
    rigs = {name: [label(name.removeprefix("optimum_"))] for name in found.rigs}
    return beside_table(["best rig by"], rigs, best, REFERENCE, f"*{REFERENCE}*")


def _combination_table(four: RigResults) -> str:
    targets = ("car07", "car", "recall")
    rows = []
    for terms in (1, 2, 3):
        cells = [str(terms)]
        for target in targets:
            found = four.combination(target, terms)
            cells += [number(found.rho), ", ".join(label(name) for name in found.terms)]
        rows.append(cells)
    heads = [head_of(target) for target in targets]
    return table(["terms", *(part for head in heads for part in (f"{head}: ρ", "terms"))], rows)


def _shares_table(four: RigResults) -> str:
    """What part of the ranks height, coverage, points, cells and coinciding rings explain."""
    own = properties()
    rows: dict[str, list[str]] = {}
    for target in ("car07", "car", "recall"):
        y, wide = four.means(target), every_predictor(SHORT[target])
        x = wide.loc[y.index, ["covered_entropy", "log_points", "log_cells"]]
        x = x.join(own[["mean height", "redundancy"]])
        found = shares(x.rank(), y.rank())
        for name, share in found.items():
            rows.setdefault(str(name), [label(str(name))]).append(f"{number(100 * share, 0)} %")
        rows.setdefault("", ["all five"]).append(f"{number(100 * found.sum(), 0)} %")
    names = {"redundancy": "rings that coincide", "mean height": "mean height of the LiDARs"}
    heads = [head_of(target) for target in ("car07", "car", "recall")]
    return table(["", *heads], [[names.get(row[0], row[0]), *row[1:]] for row in rows.values()])


if __name__ == "__main__":
    main()
