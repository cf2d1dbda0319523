"""The page of a made-up search."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from lidarplace import PAPER_PLACEMENTS
from tests.tracking.made_up_search import BASE, STRIDED, write_search
from tests.tracking.test_report import Page
from tracking.run_folders.search import SearchFolder
from tracking.search_report.build import build_search_report
from tracking.search_report.command import app
from tracking.search_report.headline import answer, next_steps, summary
from tracking.search_report.tables import rig_table


def page_of(folder: Path) -> Page:
    return Page(build_search_report(folder).read_text(encoding="utf-8"))


TITLES = ["Where the LiDARs sit", "What stays unseen", "How the search went", "Pareto front"]
TITLES += ["Constraints", "Robustness", "Did the gain become AP?", "Important parameters"]
TITLES += ["Configuration and command"]


def sections(page: Page) -> list[str]:
    return [word for word in page.words if word in TITLES]


def changed(folder: Path, **keys: Any) -> dict[str, Any]:
    """Change keys of search.json; return what it then holds."""
    file = folder / "search.json"
    search = json.loads(file.read_text()) | keys
    file.write_text(json.dumps(search))
    return search


def page_after(tmp_path: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> Page:
    """The page of a search without a feasible rig after a change of its trials."""
    folder = write_search(tmp_path / "made", complete=False, feasible=False)
    path = folder / "trials.parquet"
    change(pd.read_parquet(path)).to_parquet(path)
    return page_of(folder)


def drawn(page: Page, title: str) -> dict[str, Any]:
    """The figure with a title."""
    return next(f for f in page.figures if f["layout"]["title"]["text"] == title)


def menu(page: Page) -> list[str]:
    """The rigs that the 3D picture offers."""
    plot = next(f for f in page.figures if any(t["type"] == "scatter3d" for t in f["data"]))
    return [button["label"] for button in plot["layout"]["updatemenus"][0]["buttons"]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_search(tmp_path_factory.mktemp("search") / "made_up")


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return page_of(folder)


def test_the_first_screen_tells_value_peers_bound_mounts_and_commands(folder, page):
    assert "expected_ig 1,212.1 nats" in page.words
    assert "+21.2 % against line, the best of the paper's eight (1,000.0 nats)." in page.words
    bound = "1,200.0 nats, at most 4.0 % below the best possible of 480 candidate mounts"
    rays = "rays of 1 in 4 azimuth steps"
    assert f"As searched, with {rays}: {bound} (upper bound 1,250.0 nats)." in page.words
    fired = f"It fired {rays}, with weight"
    assert f"{fired}: the error is at most 0.2 % of one rig's value." in page.text
    assert "Feasible: it keeps all constraints (2)." in page.words
    assert "the sampler's share is 25 %." in page.text
    assert "lidarplace run runs/made_up/sweep.yaml" in page.words
    trial = pd.read_parquet(folder / "trials.parquet").loc[7]
    table = page.words[page.words.index("found_1 · expected_ig 1,212.1 nats") :]
    cells = [word.strip() for word in table if word.strip()]
    assert cells[4:10] == ["x (m)", "y (m)", "z (m)", "roll (°)", "pitch (°)", "yaw (°)"]
    degrees = [float(cell.replace("−", "-")) for cell in cells[13:19]]
    assert degrees[:3] == pytest.approx([trial[f"lidar_1.{k}_m"] for k in "xyz"], abs=5e-4)
    angles = [trial[f"lidar_1.{k}_deg"] for k in ("roll", "pitch", "yaw")]
    assert degrees[3:] == pytest.approx(angles, abs=5e-3)


def test_the_verified_lead_says_what_its_interval_and_its_seeds_are_worth(folder):
    run = SearchFolder.read(folder)
    (first, *others), best = run.search.objectives, run.search.best[0]
    objective = first.model_copy(update={"by": "recall", "unit": "%", "weights": {"all": 1.0}})
    search = run.search.model_copy(update={"objectives": (objective, *others)})

    def said(low, high, seeds):
        row = {"rig": best, "class": "all", "metric": "recall", "difference": (low + high) / 2}
        chosen = pd.DataFrame([row | {"difference_low": low, "difference_high": high}])
        config = f"search: {{seeds: {list(range(seeds))}}}"
        changed = replace(run, search=search, chosen=chosen, config=config)
        return " ".join(answer(changed).lines), next_steps(changed)[0].line

    weak, command = said(-2.8, 7, 2)
    assert "+2.1 points (95 % CI −2.8 to +7.0), not significant." in weak
    assert "Not enough evidence: only 2 generalists (at least 3)." in weak
    assert command == f"{search.command} --set 'search.seeds=[0,1,2]'"
    sure, command = said(1, 3, 3)
    assert "(95 % CI +1.0 to +3.0)." in sure
    assert "Not enough evidence" not in sure
    assert command == search.commands[0].line


def test_the_name_of_an_objective_keeps_its_case(folder):
    search = SearchFolder.read(folder).search
    named = search.first.model_copy(update={"name": "AP of Car"})
    text = summary(search.model_copy(update={"objectives": (named, search.first)}))
    assert text.startswith("Maximize AP of Car, maximize expected_ig · ")


def test_every_part_has_its_place_in_one_file_that_loads_nothing(folder, page):
    assert page.loads == []
    assert page.csp.startswith("default-src 'none'")
    assert [path.name for path in folder.iterdir() if "part" in path.name] == []
    assert sections(page) == [title for title in TITLES if title != "Pareto front"]
    assert menu(page) == ["found_1", "greedy", *PAPER_PLACEMENTS]
    assert "19 of 60 (32 %)" in page.words
    reach = "Most important for reaching good values of expected_ig (shares by PED-ANOVA)"
    assert f"{reach}: lidar_1.z 60 %, lidar_1.roll 40 %." in page.words
    assert "in percent of the value of line as designed" in page.text
    assert "percent of line as designed,<br>more is better" in json.dumps(page.figures)
    assert "Maximize expected_ig · Car, Cyclist · 200 frames" in page.text


def test_what_the_search_did_not_make_is_left_out(tmp_path):
    reason = "two models of LiDAR differ in price"
    less = {"constraints": [], "importance": None, "bound": {"value": None, "reason": reason}}
    page = page_of(write_search(tmp_path / "bare", complete=False, **less))
    assert sections(page) == [TITLES[i] for i in (0, 2, 8)]
    assert "Feasible: there were no constraints." in page.words
    assert f"No upper bound: {reason}." in page.words


def test_without_a_feasible_rig_it_tells_the_nearest_and_what_none_kept(tmp_path):
    page = page_of(write_search(tmp_path / "none", feasible=False))
    assert "No rig keeps all constraints" in page.words
    assert "None of 60 trials kept every constraint." in page.words
    assert "is trial 3. It breaks own body by 0.25 % (at most 5 %)." in page.text
    assert "No trial kept own body, which the best of them broke by 0.25 %." in page.words
    assert menu(page)[:2] == ["trial 3, infeasible", "greedy"]


def test_constraints_that_each_can_be_kept_but_not_together(tmp_path):
    def change(trials):
        odd = trials.index % 2
        trials["violation.own body"] = np.where(odd, -1.0, 1.0)
        trials["violation.distance"] = np.where(odd, 0.1, -0.1)
        trials.loc[0, ["violation.own body", "violation.distance"]] = [0.5, 0.01]
        return trials

    text = page_after(tmp_path, change).text
    # 0.5 of 5 % and 0.01 of 0.2 m: the distance is the lesser fault.
    assert "is trial 0. It breaks distance by 0.01 m (at least 0.2 m), own body by 0.5 %" in text
    assert "but no trial kept all." in text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda own: own.assign(possible=False), "All 60 trials put two LiDARs in one place."),
        (lambda own: pd.DataFrame(), "No trial was evaluated."),
    ],
)
def test_trials_without_a_rig(tmp_path, change, said):
    assert said in page_after(tmp_path, change).words


def test_a_trial_with_two_lidars_in_one_place_is_not_the_nearest(tmp_path):
    def change(trials):
        trials.loc[5, ["violation.own body", "violation.distance"]] = [-1.0, -0.1]
        return trials.assign(possible=trials.index != 5)

    page = page_after(tmp_path, change)
    one = "1 of 60 trials put two LiDARs in one place, and none of the others kept every constraint"
    assert f"{one}." in page.words
    assert "is trial 3. It breaks own body by 0.25 % (at most 5 %)." in page.text
    assert "No other trial kept own body" in page.text


def test_trials_that_kept_the_constraints_and_have_no_value(tmp_path):
    def change(trials):
        trials.loc[:2, ["violation.own body", "violation.distance"]] = -0.1
        return trials.assign(feasible=trials.index < 3)

    page = page_after(tmp_path, change)
    assert "No rig with a value" in page.words
    assert menu(page)[0] == "trial 0, without a value"
    assert "3 of 60 trials kept every constraint, but none has a value." in page.words


def test_names_cannot_become_tags(tmp_path):
    evil = '<b>"it\'s"</b><script>alert(1)</script>'
    folder = write_search(tmp_path / "evil", found=evil, model=evil, zone=evil, name=evil)
    page = page_of(folder)
    assert page.loads == []
    assert evil in page.words
    assert not any(text.strip() == "alert(1)" for _, text in page.scripts)
    ours = [f for f in page.figures if f["layout"]["title"]["text"] not in ("Slice",)]
    assert "<b>" not in json.dumps(ours)
    assert "&lt;b&gt;" in json.dumps(ours)


@pytest.mark.parametrize("lidars", [1, 12])
def test_one_and_twelve_lidars(tmp_path, lidars):
    page = page_of(write_search(tmp_path / "x", lidars=lidars, complete=False))
    assert f"{lidars} LiDAR{'s' * (lidars > 1)}: paper." in page.words


def test_several_objectives_have_a_front(tmp_path):
    folder = write_search(tmp_path / "front", several=True, trials=200)
    best = changed(folder)["best"]
    assert len(best) > 1
    page = page_of(folder)
    assert "Pareto front" in sections(page)
    assert f"Pareto front of {len(best)}, the first is found_1" in page.words
    plot = drawn(page, "expected_ig and price")
    front = next(trace for trace in plot["data"] if trace["name"] == "Pareto front")
    assert set(front["text"]) == {*best}
    assert sum(word.startswith("found_") and " · " in word for word in page.words) == len(best)
    changed(folder, front=54)
    page = page_of(folder)
    of = f"{len(best)} of 54 rigs of the Pareto front"
    assert f"{of}, the first is found_1" in page.words
    assert f"{of}: a rig that is better in one objective is worse in another." in page.words


def test_a_page_of_2000_trials_stays_small(tmp_path):
    built = build_search_report(write_search(tmp_path / "big", trials=2000))
    assert built.stat().st_size < 8e6


def test_warnings_name_bound_edges_failures_and_few_evaluations(tmp_path):
    bound = {"value": 1150.0, "candidates": 10, "best_value": 1200.0, "gap_percent": -4.3}
    folder = write_search(tmp_path / "warned", complete=False, bound=bound)
    rigs = changed(folder)["rigs"]
    rigs["found_1"]["mounts"][1][:3] = [0.6, 0.1, 2.2]
    changed(folder, rigs=rigs, linear_share=0.9)
    trials = pd.read_parquet(folder / "trials.parquet")
    trials.loc[5, "state"] = "FAIL"
    trials.to_parquet(folder / "trials.parquet")
    page = page_of(folder)
    assert "The best rig is above the upper bound." in page.text
    assert "1,200.0 nats, above the upper bound of any rig of 10 candidate mounts" in page.text
    assert "is at the edge of what was allowed (" in page.text
    assert "LiDAR 2: x, y, z" in page.text
    assert "1 of 60 trials failed." in page.words
    assert "58 evaluations are few for 25 parameters" in page.text
    assert "Expected IG counts rays here: it is 90 % of what" in page.text


def test_a_verification_without_the_rig_to_compare_with_has_values_alone(tmp_path):
    folder = write_search(tmp_path / "tall")
    with_it = page_of(folder)
    rows = pd.read_parquet(folder / "verified.parquet")
    unknown = dict.fromkeys(("difference", "difference_low", "difference_high"), np.nan)
    rows[rows["rig"] != "line"].assign(**unknown).to_parquet(folder / "verified.parquet")
    assert "No detector evaluated line, the baseline of this comparison" in page_of(folder).text
    assert "No detector evaluated" not in with_it.text


def test_a_search_that_did_not_beat_the_paper_says_so(tmp_path):
    folder = write_search(tmp_path / "worse", complete=False)
    rigs = changed(folder)["rigs"]
    rigs["found_1"]["values"]["expected_ig"] = BASE - 1
    changed(folder, rigs=rigs)
    page, line = page_of(folder), "line, the best of the paper's eight"
    assert f"The best rig is not better than {line}." in page.words
    assert f"−0.1 % against {line} (1,000.0 nats)." in page.words
    rigs["found_1"] |= {key: rigs["found_1"][key][:1] for key in ("mounts", "models", "zones")}
    changed(folder, rigs=rigs)
    both = f"The best rig is not better than {line}, with 4 LiDARs instead of 1."
    assert both in page_of(folder).words


def test_the_history_draws_everything_as_searched(page):
    plot = drawn(page, "expected_ig")
    levels = {t["name"]: t["y"] for t in plot["data"] if t["mode"] == "lines"}
    assert levels["line, best of the paper"] == pytest.approx([STRIDED * BASE] * 2)
    assert levels["greedy"] == pytest.approx([1100.0] * 2)
    best = next(t for t in drawn(page, "Upper bound of expected_ig")["data"] if "best" in t["name"])
    assert best["y"] == pytest.approx([1200.0] * 2)
    rays = "as searched, with rays of 1 in 4 azimuth steps"
    assert f"All figures here are {rays}; the table of rigs is with all rays." in page.words
    assert "Rigs, with all rays" in page.words
    assert f"Greedy, step by step · {rays}" in page.words


def test_the_best_of_the_paper_is_so_with_all_rays(tmp_path):
    folder = write_search(tmp_path / "order", complete=False)
    rigs = changed(folder)["rigs"]
    rigs["center"]["searched"]["expected_ig"] = 1050.0
    changed(folder, rigs=rigs)
    names = [t["name"] for t in drawn(page_of(folder), "expected_ig")["data"]]
    assert "line, best of the paper" in names


def test_without_fewer_rays_there_is_nothing_to_tell_apart(tmp_path):
    folder = write_search(tmp_path / "all", stride=None, sampler_seconds=0, evaluation_seconds=0)
    page = page_of(folder)
    bound = "At most 4.0 % below the best possible of 480 candidate mounts"
    assert f"{bound} (upper bound 1,250.0 nats)." in page.words
    assert "1 in 4" not in page.text
    assert "all rays" not in page.text
    assert "last command: sampler" not in page.text


def test_a_class_that_does_not_occur_has_no_share(folder, tmp_path):
    whole = shutil.copytree(folder, tmp_path / "absent")
    maps = dict(np.load(whole / "maps.npz"))
    empty = {name: 0 * values if "Cyclist" in name else values for name, values in maps.items()}
    np.savez_compressed(whole / "maps.npz", **empty)
    words = [word for word in page_of(whole).words if word.strip()]
    start = words.index("unseen by found_1")
    row = words.index("Cyclist", start)
    assert words[row : row + 5] == ["Cyclist", "0", "–", "–", "–"]


def test_the_baseline_better_in_another_case_is_a_caution(folder, tmp_path):
    lost = shutil.copytree(folder, tmp_path / "lost")
    rows = pd.read_parquet(lost / "robustness.parquet")
    rows.loc[(rows["rig"] == "line") & rows["case"].str.startswith("scene"), "value"] = 1300.0
    more = rows[(rows["rig"] == "line") & (rows["case"] == "LiDAR 1 fails")]
    # A LiDAR of the baseline whose loss costs more, and one whose loss costs less.
    others = [more.assign(case=f"LiDAR {i} fails", value=v) for i, v in ((2, 700.0), (3, 900.0))]
    pd.concat([rows, *others]).to_parquet(lost / "robustness.parquet")
    values = "scene: Town05, 120 cars, expected_ig 1,300.0 nats against 1,200.0 nats"
    assert f"line is better than found_1 in other cases ({values})." in page_of(lost).words
    assert "in other cases (" not in page_of(folder).text


def test_rigs_that_break_a_constraint_are_marked_and_never_the_best(tmp_path):
    folder = write_search(tmp_path / "marked", complete=False)
    rigs = changed(folder)["rigs"]
    rigs["line"]["feasible"] = False
    rigs["line"]["values"]["expected_ig"] = 1500.0
    rigs["line"]["measures"]["own body"] = 5.5
    rigs["line"]["mounts"] = rigs["line"]["mounts"][:3]
    for key in ("models", "zones"):
        rigs["line"][key] = rigs["line"][key][:3]
    changed(folder, rigs=rigs)
    page = page_of(folder)
    start = page.words.index("Rigs, with all rays")
    table = [word.strip() for word in page.words[start:] if word.strip()]
    row = table.index("line")
    assert table[row : row + 5] == ["line", "paper", "not feasible", "3", "1,500.0"]
    assert table.index("found_1") < table.index("greedy") < row
    broken = (
        "line, the best of the paper's eight, with 3 LiDARs instead of 4, infeasible by own body"
    )
    assert f"−19.2 % against {broken} (1,500.0 nats)." in page.words
    assert f"The best rig is not better than {broken}." in page.words
    cells = rig_table("Rigs", SearchFolder.read(folder).search)
    assert [(cells.rows[row][0], column) for row, column in cells.best] == [("found_1", 4)]


def test_the_menu_has_the_best_greedy_and_all_of_the_paper(tmp_path):
    folder = write_search(tmp_path / "menu", complete=False)
    search = changed(folder)
    more = {f"found_{i}": search["rigs"]["found_1"] for i in range(2, 8)}
    rigs = search["rigs"] | more | {"refined": search["rigs"]["greedy"]}
    changed(folder, rigs=rigs)
    page = page_of(folder)
    assert menu(page) == ["found_1", "greedy", "refined", *PAPER_PLACEMENTS, "found_2"]
    assert "Choose a rig in the menu: the best, greedy's, the paper's, others." in page.text
    changed(folder, best=["found_1", *more])
    page = page_of(folder)
    first = [f"found_{i}" for i in range(1, 5)]
    assert menu(page) == [*first, "greedy", "refined", *PAPER_PLACEMENTS]
    assert "Choose a rig in the menu: 4 of the front, greedy's, the paper's. Drag" in page.text


def test_peers_without_a_price_and_of_which_model(tmp_path):
    folder = write_search(tmp_path / "price", several=True, complete=False)
    search = changed(folder)
    for rig in search["rigs"].values():
        if rig["role"] == "paper":
            rig["values"]["price"] = rig["searched"]["price"] = None
    wide = search["models"]["paper"] | {"price": 500.0}
    unknown = search["models"]["paper"] | {"price": None}
    models = {"paper": unknown, "wide": wide}
    changed(folder, rigs=search["rigs"], models=models)
    page = page_of(folder)
    assert "; price of line is unknown." in page.text
    assert "The paper's rigs have the LiDAR of the key `lidar`, not of search.models." in page.words
    changed(folder, objectives=search["objectives"][::-1])
    assert "price of line is unknown." in page_of(folder).words


def test_the_command_rebuilds_it(folder):
    result = CliRunner().invoke(app, [str(folder)], catch_exceptions=False)
    assert result.stdout.strip() == str(folder / "search.html")


def test_pairs_are_bought_together_and_each_model_has_edges_of_its_own(tmp_path):
    folder = write_search(tmp_path / "pairs", complete=False)
    written = changed(folder)
    rig, (zone, *_) = written["rigs"]["found_1"], written["zones"]
    model = rig["models"][0]
    rig["mounts"] = [[0.1, 0.15, 2.0, 0.0, 0.35, 0.0] for _ in rig["mounts"]]
    spans = {"roll_deg": [-10, 10], "pitch_deg": [20.05, 60], "yaw_deg": [0, 0]}
    changed(folder, rigs=written["rigs"], zones=[zone | {"pitch_deg": [0, 90], "mirrored": True}])
    page = page_of(folder)
    assert (
        f"LiDARs in {zone['name']} are in mirrored pairs: both of a pair are bought." in page.text
    )
    assert "LiDAR 1: pitch" not in page.text
    of_model = zone | {"pitch_deg": [0, 90], "models": {model: spans}}
    changed(folder, zones=[of_model])
    page = page_of(folder)
    assert "LiDAR 1: pitch" in page.text, "20 degrees are the least of this model"
    assert "mirrored pairs" not in page.text
