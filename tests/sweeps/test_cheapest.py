"""The cheapest rig of a grid, against every rig of it."""

import itertools
import json
import math
import re
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml
from rich.console import Console
from typer.testing import CliRunner

from lidarplace import Lidar, Mount
from lidarplace.configuration.placement import read_placement
from lidarplace.requirements.check_requirements import check_requirements
from sweeps.commands.cheapest import app
from sweeps.search.cheapest import polish as polish_module
from sweeps.search.cheapest.choose import _Work, cheapest
from sweeps.search.cheapest.polish import needed_for, polish
from sweeps.search.cheapest.result import proof
from sweeps.search.cheapest.rig_check import cost_of
from sweeps.search.greedy.candidates import candidates_of
from sweeps.search.problem.assess import Traffic, assess
from sweeps.search.problem.generalist_trials import trials_of_rigs
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar, ordered
from sweeps.search.verification import reevaluation as recall_module
from sweeps.stages.task import with_inputs
from tests.sweeps.search_files import write_search

MODELS = yaml.safe_load("""
wide: {beams: 8, azimuth_steps: 300, price: 4, power: 9, size_mm: [500, 500, 400]}
flash: {beams: 12, azimuth_steps: 300, azimuth_deg: [-60, 60], price: 2.5, power: 12}
lossy:
  {beams: 10, azimuth_steps: 300, drop_off: 0.3, price: 3, power: 5, size_mm: [300, 300, 300]}
""")
ZONES = yaml.safe_load("""
roof: {x: [0, 0.6], y: [-0.7, 0.7], z: [1.8, 2.3]}
nose: {x: 2.45, y: [-0.5, 0.5], z: 0.6}
left: {x: [0, 0.6], y: 1.05, z: 0.9}
""")
WHERE = [{"x": [2, 5], "y": [-2, 2]}, {"distance": [0.5, 2]}, {"x": [-2, 2], "y": [1.5, 3]}]
WHERE += [{"sectors": ["front"], "distance": [1, 4]}]


def drawn(seed, by):
    """Keys of a small search: requirements of all kinds, constraints, and what is to be least."""
    random = np.random.default_rng(seed)

    def one_of(*values):
        return values[random.integers(len(values))]

    requirements = []
    for number in range(random.integers(1, 4)):
        where = dict(one_of(*WHERE))
        measure = one_of("points", "points", "cells", "probability", "coverage")
        settings = {"name": f"r{number}", "where": where, "step": one_of(1.0, 1.5), "also_when": {}}
        if measure == "coverage":
            settings |= {"at_least": {"coverage": one_of(0.15, 0.3, 0.45)}, "step": 0.5}
            where["z"] = [0, 1]
        else:
            least = {"points": one_of(4, 8, 16, 32), "cells": one_of(2, 4, 7), "probability": 0.05}
            settings |= {"what": "Pedestrian", "at_least": {measure: least[measure]}}
            settings["for"] = one_of(1.0, 0.8, 0.6)
            if random.random() < 0.25:
                settings["at_least"]["sensors"] = 2
        if random.random() < 0.4:
            settings["also_when"] |= one_of({"one_lidar_dead": True}, {"sensors_dead": 2})
        if random.random() < 0.2:
            settings["also_when"] |= {"range_factor": 0.2}
        if random.random() < 0.25:
            settings["also_when"] |= {"mounts_off": {"angle_deg": 1.0, "draws": 2}}
        requirements.append(settings)
    zones = {name: dict(settings) for name, settings in ZONES.items()}
    if random.random() < 0.5:  # in a row, where they hide much from each other
        zones = {"rack": {"x": [0, 2.4], "y": 0, "z": 1.8}, "nose": zones["nose"]}
    keys = {"lidars": [1, 3]}
    if random.random() < 0.4:
        for settings in zones.values():
            settings["lidars"] = [0, int(random.integers(1, 3))]
        if "left" in zones:
            zones["left"]["mirrored"] = bool(random.random() < 0.7)
        next(iter(zones.values()))["lidars"] = [1, 2]
        del keys["lidars"]
    constraints = {"distance": one_of(0.0, 0.2, 0.9)}
    for name, limit, share in (("price", 9, 0.3), ("body_share", 0.45, 0.3), ("facing", 0, 0.2)):
        if random.random() < share:
            constraints[name] = limit
    vehicle = None
    if random.random() < 0.3:
        boxes = [[[-5, -0.9, 0.4], [-1.2, 0.9, 1.4]]]
        trailer = {"hitch": [-1.2, 0], "boxes": boxes, "angles_deg": [-70, 50]}
        vehicle = {"boxes": [[[-1, -0.95, 0], [2.35, 0.95, 1.5]]], "trailer": trailer}
    fixed = [{"x": 0.0, "y": 0.0, "z": 2.0, "model": "wide"}] if random.random() < 0.2 else []
    order = random.permutation(list(MODELS))  # before their number is drawn
    models = {str(name): MODELS[str(name)] for name in order[: random.integers(1, 4)]}
    keys |= {"zones": zones, "vehicle": vehicle, "fixed": fixed, "constraints": constraints}
    keys |= {"models": models | ({"wide": MODELS["wide"]} if fixed else {})}
    keys |= {"requirements": requirements, "pitch_deg": 15, "roll_deg": 0, "objective": "price"}
    if by == "price" and "lossy" in keys["models"] and len(keys["models"]) > 1:
        keys["models"]["lossy"] = MODELS["lossy"] | {"price": one_of(0, 2)}  # equal sums
    keys |= {"cheapest": {"by": by, "seconds": 60}}
    return keys | {"greedy": {"position_step": 0.6, "refine": 0}}


def least_of_all(problem):
    """What the cheapest of all rigs of the grid costs, and of equal ones the least number of
    LiDARs, each judged as a search does."""
    space, search = problem.space, problem.file.search
    fixed = ordered(space.fixed)
    candidates = [rig for rig in candidates_of(problem) if rig != fixed]
    low, high = space.numbers
    best = math.inf, 0
    for size in range(1, high + 1):
        for parts in itertools.combinations(candidates, size):
            lidars = [lidar for rig in parts for lidar in rig]
            zones = [rig[0].zone for rig in parts]
            models = [lidar.model for lidar in lidars]
            counts = {n: (zone.lidars, zones) for n, zone in search.zones.items() if zone.lidars}
            counts |= {n: (m.count, models) for n, m in search.models.items() if m.count}
            if not low <= len(lidars) <= high or not all(
                least <= names.count(name) <= most
                for name, ((least, most), names) in counts.items()
            ):
                continue
            rig = ordered([*fixed, *lidars])
            cost = round(cost_of(rig, problem), 6), len(rig)
            if cost < best and assess(rig, problem.criteria, NOTHING).feasible:
                best = cost
    return best


NOTHING = Traffic({}, None)
BY = ("lidars", "price", "power", "height")
BY_POWER = ["search.cheapest.by=power"]


@pytest.mark.parametrize("by_cuts", [False, True])
@pytest.mark.parametrize(("seed", "by"), [*enumerate(BY * 2), (51, "price"), (51, "height")])
def test_it_is_the_cheapest_of_all_rigs(tmp_path, monkeypatch, seed, by, by_cuts):
    monkeypatch.setattr("lidarplace.requirements.layout.FINEST_M", 0.3)  # all rigs are refined
    if by_cuts:  # neither a rig to begin with nor one with more to spare: rows and cuts alone
        monkeypatch.setattr(_Work, "greedy", lambda self, by_cost: False)
        monkeypatch.setattr(_Work, "try_others", lambda self, cost: None)
    problem = read_problem(write_search(tmp_path, search=drawn(seed, by)))
    chosen = cheapest(problem)
    assert chosen.gap == 0 or chosen.rig is None
    cost, number = least_of_all(problem)
    assert (chosen.cost, chosen.fewest) == (pytest.approx(cost), number)
    if chosen.rig is not None:
        assert len(chosen.rig) == number
        assert all(needed_for(problem, chosen.rig, None))
        assert assess(chosen.rig, problem.criteria, NOTHING).feasible
        assert cost_of(chosen.rig, problem) == pytest.approx(chosen.cost)
    else:
        assert chosen.bound == math.inf


COUNTS = yaml.safe_load("""
- {lidars: 3, models: {wide: [0, 1], flash: [1, 2], lossy: [1, 1]}}
- {lidars: [2, 4], models: {flash: 2}, zones: {left: [1, 1]}}
- {lidars: [2, 3], models: {wide: [0, 1], flash: [0, 1]}, zones: {nose: [0, 1], left: [0, 1]}}
- {lidars: 4, models: {wide: 3}}
""")


@pytest.mark.parametrize("counts", COUNTS)
@pytest.mark.parametrize("by", ["lidars", "price"])
def test_bounds_in_all_by_zone_and_by_model_are_kept(tmp_path, counts, by):
    zones = {name: dict(zone) for name, zone in ZONES.items()}
    zones["left"] |= {"mirrored": True, "models": {"flash": {"pitch_deg": 40}, "wide": {}}}
    for name, bound in counts.get("zones", {}).items():
        zones[name]["lidars"] = bound
    models = {name: dict(model) for name, model in MODELS.items()}
    for name, bound in counts["models"].items():
        models[name]["count"] = bound
    settings = {"cheapest": {"by": by}, "greedy": {"position_step": 0.7, "refine": 0}}
    keys = SMALL | settings | {"zones": zones, "models": models, "lidars": counts["lidars"]}
    problem = read_problem(write_search(tmp_path, search=keys | {"requirements": [ONE]}))
    chosen = cheapest(problem)
    assert (chosen.gap, chosen.fewest) == (0, len(chosen.rig))
    assert (chosen.cost, chosen.fewest) == pytest.approx(least_of_all(problem))
    for lidar in chosen.rig:
        steep = (lidar.zone, lidar.model) == ("left", "flash")
        assert math.degrees(lidar.mount.pitch) == pytest.approx(40 if steep else 0, abs=0.01)


EASY = {"name": "somebody ahead", "where": {"x": [3, 5], "y": [-1, 1]}, "what": "Pedestrian"}
EASY |= {"at_least": {"points": 6}, "step": 1.0, "also_when": {"one_lidar_dead": True}}
SMALL = {"lidars": [1, 3], "models": MODELS, "requirements": [EASY], "objective": "price"}
SMALL |= {"zones": {"nose": {"x": 2.45, "y": [-0.6, 0.6], "z": [0.6, 0.9]}}}
SMALL |= {"greedy": {"position_step": 0.3, "refine": 2}}


def run(folder, *options, **changes):
    path = write_search(folder, search=SMALL | changes)
    return CliRunner().invoke(app, [str(path), *options], catch_exceptions=False)


def test_the_command_writes_a_rig_that_a_requirements_file_takes(tmp_path):
    result = run(tmp_path, cheapest={"by": "price"})
    assert result.exit_code == 0, result.output
    assert "price 5 with 2 LiDARs: the least of the grid, which is proven" in result.output
    folder = tmp_path / "runs/small/cheapest"
    content = json.loads((folder / "cheapest.json").read_text())
    assert (content["cost"], content["bound"], content["gap"]) == (5, 5, 0)
    assert content["refined_cost"] == 5
    assert content["margin"] > 1, "moved off the grid, it has something to spare"
    rig = read_placement(folder / "placement.yaml", Lidar.paper())
    assert len(rig.mounts) == 2
    problem, other = (
        read_problem(tmp_path / "small.yaml", overrides) for overrides in ([], BY_POWER)
    )
    assert problem.key == other.key, "a search is the same"
    plain = problem.criteria.carrier
    (outcome,) = check_requirements(plain.requirements, rig, plain.vehicle)
    assert outcome.met
    assert outcome.worst.value / 6 == pytest.approx(content["margin"])
    assert result.output.count("somebody ahead at x") == 2, "it says what each LiDAR is needed for"
    page = (folder / "cheapest.html").read_text()
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", page)
    assert [cell.partition(" at x")[0] for cell in cells].count("somebody ahead") == 3
    assert cells[cells.index("together") :][:5] == ["together", "2", "–", "–", "5"]
    assert "Least price, proven for the grid: " in page
    assert "no rig of the grid costs less than 5" in page


ONE = EASY | {"also_when": {}}
LEFT = ONE | {"name": "aside", "where": {"x": [-1, 1], "y": [2.5, 3.5]}}
NOSE = {"x": 2.45, "y": 0.0, "z": 0.6}
PAIR = {"x": 0.0, "y": 1.05, "z": 0.9}
FIXED = [{"x": 0.0, "y": 0.0, "z": 2.0, "model": "wide"}]


@pytest.mark.parametrize(
    ("zones", "changes", "reasons"),
    [
        ({"nose": NOSE | {"y": [-0.3, 0.3]}}, {"lidars": [2, 3]}, {"search.lidars"}),
        ({"nose": NOSE}, {"lidars": 1}, {"somebody ahead"}),
        ({"nose": NOSE}, {"lidars": 1, "fixed": FIXED}, {"search.fixed", "search.lidars"}),
        (
            {"nose": NOSE | {"lidars": 1}, "left": PAIR | {"lidars": 1}},
            {},
            {"somebody ahead", "search.zones.left.lidars"},
        ),
        (
            {"left": PAIR | {"lidars": [0, 1], "mirrored": True}},
            {"requirements": [LEFT]},
            {"without LiDAR 2, its mirror image, too: aside", "aside"},
        ),
    ],
)
def test_each_lidar_has_a_reason(tmp_path, zones, changes, reasons):
    keys = {key: value for key, value in SMALL.items() if key != "lidars"} | {"zones": zones}
    search = keys | {"requirements": [ONE]} | changes
    problem = read_problem(write_search(tmp_path, search=search))
    chosen = cheapest(problem)
    assert (chosen.gap, chosen.fewest) == (0, len(chosen.rig))
    why = needed_for(problem, chosen.rig, None)
    assert {reason.partition(" at x ")[0] for reason in why} == reasons


def test_an_answer_says_that_a_pair_is_bought_together(tmp_path):
    keys = {"zones": {"left": PAIR | {"lidars": [0, 1], "mirrored": True}}, "lidars": 2}
    keys |= {"requirements": [LEFT]}
    assert "LiDARs in left are in mirrored pairs: both of a pair are bought." in (
        run(tmp_path, **keys).output
    )
    assert json.loads(run(tmp_path, "--json", **keys).output)["mirrored"] == ["left"]


def test_refinement_leaves_out_what_is_not_needed(tmp_path):
    keys = SMALL | {"requirements": [ONE], "cheapest": {"by": "height"}}
    problem = read_problem(write_search(tmp_path, search=keys))
    wide = {rig[0].mount.y: rig[0] for rig in candidates_of(problem) if rig[0].model == "wide"}
    several = ordered([*wide.values()][::2])
    assert set(needed_for(problem, several, None)) == {"nothing: the height is the same without it"}
    by_price = read_problem(problem.path, ["search.cheapest.by=price"])
    assert set(needed_for(by_price, several, None)) == {
        "nothing: search.cheapest.seconds were over before it was left out"
    }
    rig = polish(problem, several, None)
    assert len(rig) == 1
    assert needed_for(problem, rig, None) == ["somebody ahead"]


def test_refinement_ends_in_time(tmp_path, monkeypatch):
    keys = SMALL | {"requirements": [ONE], "cheapest": {"by": "height", "seconds": 0.5}}
    problem = read_problem(write_search(tmp_path, search=keys))
    rig, latest = cheapest(problem).rig, time.monotonic() + 60

    def endless(problem, rig):
        assert time.monotonic() < latest
        yield rig

    monkeypatch.setattr(polish_module, "_cheaper", endless)
    monkeypatch.setattr(polish_module, "check_rig", lambda *_: SimpleNamespace(broken=(), margin=1))
    assert len(polish(problem, rig, None)) == len(rig)


def test_the_file_of_a_rig_names_the_models_of_the_catalogue(tmp_path):
    models = {
        "front": {"name": "bpearl", "price": 3},
        "bent": {"name": "xt32", "range": 50, "price": 6},
    }
    path = write_search(tmp_path, search=SMALL | {"models": models}, lidar="vlp16")
    problem = read_problem(path)
    lidars = [MountedLidar(name, "nose", Mount(2.45, y, 0.6)) for y, name in enumerate(models)]
    rig = (*lidars, MountedLidar("lidar", "nose", Mount(2.45, 2.0, 0.6)))
    written = tmp_path / "rig.yaml"
    written.write_text(problem.placement_text(rig))
    names = [mount["lidar"] for mount in yaml.safe_load(written.read_text())["mounts"]]
    assert names == ["bpearl", {"name": "xt32", "range": 50.0}, "vlp16"]
    expected = [problem.models[lidar.model] for lidar in rig]
    assert [*read_placement(written, Lidar.paper()).lidars] == expected


def test_none_is_feasible(tmp_path):
    run(tmp_path)
    far = EASY | {"at_least": {"points": 500}}
    result = run(tmp_path, requirements=[far])
    assert result.exit_code == 1
    assert "No rig of the grid meets everything, which is proven" in result.output
    assert "FAIL" in result.output
    assert not (tmp_path / "runs/small/cheapest/placement.yaml").exists()
    page = (tmp_path / "runs/small/cheapest/cheapest.html").read_text()
    assert "No rig passes" in page
    assert re.search(r"this one is closest: somebody ahead has \d+ of 500 points", page)
    content = json.loads(run(tmp_path, "--json", requirements=[far]).output)
    assert (content["found"], content["bound"]) == (False, None)
    assert content["broken"] == ["requirement.somebody ahead"]
    assert 0 < content["cases"][0]["value"] < 500, "the closest has some"


def test_a_rig_that_the_detector_rejects_is_excluded(tmp_path):
    few = {"cheapest": {"recall": 80.0}, "models": {"flash": MODELS["flash"]}}
    problem = read_problem(write_search(tmp_path, search=SMALL | few))
    evaluated = []

    def recall(rig):
        evaluated.append(rig)
        return 90.0 if len(rig) == 3 else 70.0

    chosen = cheapest(problem, recall)
    assert (chosen.cost, chosen.bound, chosen.gap) == (3, 3, 0)
    assert chosen.value == 90.0
    why = needed_for(problem, chosen.rig, recall)
    assert "price 70.0" in why
    assert all(why)
    pairs = {rig for rig in evaluated if len(rig) == 2}
    good = itertools.combinations([rig[0] for rig in candidates_of(problem)], 2)
    assert pairs == {r for r in map(ordered, good) if assess(r, problem.criteria, NOTHING).feasible}


def test_the_generalist_of_the_package_is_asked_on_the_traffic_of_the_choice(monkeypatch):
    demo = Path(__file__).parents[2] / "examples/search_demo.yaml"
    problem = read_problem(demo, ["search.cheapest.recall=50"])
    row = {"class": "all", "metric": "recall", "iou": 0.7, "difficulty": "all"}
    row |= {"value": 61.0, "ground_truths": 9}
    ran = []

    class Store:
        def read(self, task, of):
            assert task in ran
            return of(SimpleNamespace(metrics=pd.DataFrame([row])))

    monkeypatch.setattr(
        recall_module, "run_tasks", lambda *arguments: ran.extend(arguments[-1]) or {}
    )
    recall = recall_module.recall_of(Console(), problem, Store())
    assert recall(problem.paper_rigs()["line"]) == 61.0
    line = {"x": problem.paper_rigs()["line"]}
    (tests,) = trials_of_rigs(problem, {}, line, problem.tests.search)["x"]
    searched = {task.key for task in with_inputs(trial.evaluate for trial in tests)}
    scenes = {task.key for task in ran if task.stage.name == "scene"}
    assert scenes
    assert not scenes & searched, "what chooses sees other traffic than a search"
    high = MountedLidar("lidar", "", Mount(0.0, 0.0, 9.0))
    assert recall((high,)) == -math.inf, "it does not know such rigs"


def test_time_that_is_over_leaves_a_gap(tmp_path, monkeypatch):
    problem = read_problem(write_search(tmp_path, search=SMALL | {"cheapest": {"by": "price"}}))
    monkeypatch.setattr(_Work, "left", property(lambda self: 1.0 - self.rounds))
    monkeypatch.setattr(_Work, "drop", lambda self, chosen: None)
    found = cheapest(problem)
    assert found.counts["rounds"] == 1
    assert assess(found.rig, problem.criteria, NOTHING).feasible
    assert 0 <= found.gap < 1
    assert found.bound <= 5 <= found.cost
    least = replace(found, bound=found.cost, fewest=1)
    assert "which is proven; at that price at least 1 are needed, when" in proof(problem, least)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"greedy": None}, "greedy"),
        ({"requirements": []}, "requirements"),
        ({"models": {}, "cheapest": {"by": "price"}}, "cheapest.by"),
        ({"cheapest": {"recall": 80}}, "cheapest.recall"),
        ({"cheapest": {"by": "weight"}}, "cheapest.by"),
    ],
)
def test_mistakes_are_one_line(tmp_path, changes, key):
    result = run(tmp_path, **changes)
    assert result.exit_code == 2
    assert f": search.{key}: expected " in result.stderr
    assert result.stderr.count("\n") == 1
