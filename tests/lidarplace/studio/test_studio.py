"""The studio as a Python object."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import ExpectedRecall, Lidar, Mount, OccupancyGrid, Placement, evaluate
from lidarplace.configuration.placement import read_placement
from lidarplace.configuration.yaml import parse_yaml, read_yaml_file
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.catalogue.datasheet import datasheet
from lidarplace.scenes.sumo.settings import SumoScene
from lidarplace.studio.blind_ground import EDGE_M, LOWEST_M, blind_ground
from lidarplace.studio.log_frames import scene_of, simulated_scene
from lidarplace.studio.numbers import RECALL_FRAMES, thinned
from lidarplace.studio.page.tables import left_out_message
from lidarplace.studio.rigs_file import RigsSettings, read_rigs
from lidarplace.studio.studio import Studio
from lidarplace.studio.sweep_files import MOST_RAYS, found_by_sweep
from lidarplace.studio.violations import violations
from sweeps.plan.plan import read_plan
from sweeps.results.rigs import rigs_yaml
from tests.lidarplace.requirements.brute_force import hits_of
from tests.lidarplace.studio.rigs import ROI, TEXT, log_of, studio_of, written
from tests.refused import refused


def test_the_numbers_are_those_of_evaluate(studio):
    studio.pose(0, x=0.5, yaw=30.0)
    studio.add(x=-0.5, z=1.9, pitch=5.0)
    numbers = studio.numbers()
    grid = OccupancyGrid.from_boxes(studio.log.boxes, ROI, "Car", frames=len(studio.log.frames))
    expected = evaluate(grid, studio.placement)
    recall = ExpectedRecall.from_log(studio.log, ROI, ["Car"], frames=RECALL_FRAMES)
    assert numbers.s_mig["Car"] == expected.s_mig < 0
    assert numbers.covered_entropy["Car"] == expected.covered_entropy
    assert numbers.expected_recall["Car"] == recall.of(studio.placement)["expected_recall"]["Car"]
    assert len(studio.placement.mounts) == 3


def test_moving_is_coarser_in_rays_alone(studio):
    many = replace(studio.file.lidar.lidar(), azimuth_steps=36_000)
    rig = Placement("many", studio.rig.mounts, lidar=many)
    assert {lidar.rays for lidar in thinned(rig, 40_000).lidars} == {40_000}
    assert thinned(rig, 10**6) == rig
    coarse, exact = (studio.meter.measure(rig, exact) for exact in (False, True))
    assert coarse.s_mig == exact.s_mig
    assert coarse.expected_recall["Car"] < exact.expected_recall["Car"]


def test_without_a_lidar_nothing_is_seen(tmp_path):
    studio = studio_of(tmp_path, "")
    assert studio.rig.name == "mine"
    assert studio.placement is None
    assert studio.numbers().s_mig == {"Car": 0.0}
    assert studio.numbers().expected_recall == {"Car": 0.0}
    assert studio.view.objects(None)["points"].tolist() == [0]
    assert len(studio.view.cloud(None, 1000).points) == 0
    assert studio.ground("blind for an adult").share == 1.0


def test_what_a_frame_shows(studio):
    rig = studio.placement
    table = studio.view.objects(rig)
    assert table["points"].min() > 0
    cloud = studio.view.cloud(rig, 10**6)
    assert set(cloud.lidar.tolist()) == {0, 1}
    assert len(cloud.points) == len(cloud.lidar)
    low, high = np.array([ROI.x, ROI.y, (-0.5, 4)]).T
    assert (cloud.points >= low).all()
    assert (cloud.points <= high).all()
    assert 0 < len(studio.view.cloud(rig, 2000).points) <= 2000
    studio.show_frame(2)
    assert studio.view.number == 2


def test_violations_say_where_and_by_how_much(tmp_path):
    limits = "{distance: 0.5, price: 3, power: 10, body_share: 0.01}"
    text = TEXT.replace("{distance: 0.2}", limits)
    text += "keep_out: {hatch: {x: [-0.2, 0.2], y: [-0.9, -0.3], z: [1.6, 1.85]}}\n"
    studio = studio_of(tmp_path, text)
    studio.pose(0, y=1.0, z=2.1)  # 0.3 m and 0.1 m outside of the zone
    excess = {(v.limit, v.lidars): v.excess for v in studio.violations()}
    assert excess["zone", (0,)] == pytest.approx(math.hypot(0.3, 0.1))
    assert excess["keep_out", (1,)] == pytest.approx(0.05)
    assert math.isnan(excess["price", ()])  # the file's own LiDAR has no price
    assert excess["body_share", (1,)] > 0.1  # what is kept out hides the view as the body does
    studio.pose(0, x=0.0, y=-0.2, z=1.8)
    assert {v.limit: v.excess for v in studio.violations()}["distance"] == pytest.approx(0.1)
    studio.pose(1, x=0.0, y=0.0, z=1.0)
    assert {v.limit: v.excess for v in studio.violations()}["body"] == pytest.approx(0.5)
    for number in (0, 1):
        studio.model(number, "vlp16")
    assert studio.totals()["Price"] == 8
    excess = {v.limit: v.excess for v in studio.violations()}
    assert excess["price"] == 5
    watts = 2 * datasheet("vlp16").power_w
    assert studio.totals()["Power, W"] == watts
    assert excess["power"] == watts - 10
    studio.model(1, "hdl64e")  # of which the file tells no price
    (price,) = [v.text for v in studio.violations() if v.limit == "price"]
    assert price == "price: of hdl64e it is not known"
    assert all(v.text for v in studio.violations())


def test_a_requirement_that_fails_says_where_and_the_ground_shows_it(tmp_path):
    text = """
lidar: {beams: 5, elevation_deg: [-50, -10], azimuth_steps: 90, range: 30}
placements: {a: {mounts: [{x: 0.6, y: 0.4, z: 1.8}]}}
requirements:
  - name: somebody near
    where: {distance: [0.2, 1.4]}
    what: {length: 0.5, width: 0.5, height: 1.6, headings: 1}
    at_least: {points: 4}
    step: 0.9
"""
    studio = studio_of(tmp_path, text)
    (outcome,) = studio.outcomes()
    few = []
    for x, y in outcome.positions.points.tolist():
        (hits,) = hits_of(studio.placement, studio.file.body, [x, y, 0.8, 0.5, 0.5, 1.6, 0.0])
        few += [(x, y)] if len(hits) < 4 else []
    ground = studio.ground("somebody near")
    assert sorted(map(tuple, ground.middles.tolist())) == sorted(few)
    assert 0 < len(few) < len(outcome.positions.points)
    assert ground.share == len(few) / len(outcome.positions.points)
    assert ground.edge == 0.9
    (violation,) = studio.violations()
    assert (violation.limit, violation.excess) == ("requirement", 4 - outcome.worst.value)
    assert "somebody near: 0 points, 4 short of 4; worst at x" in violation.text
    assert studio.outcomes() is studio.outcomes()  # is worked out once a rig
    studio.enable(0, False)
    assert [v.text for v in studio.violations()] == ["somebody near: no LiDAR works"]
    assert studio.ground("somebody near") is None


def test_two_in_one_place_are_told_and_not_measured_and_a_lidar_snaps_onto_its_zone(studio):
    studio.pose(1, x=0.1, y=0.6)
    assert studio.placement is None
    assert "in one place" in studio.violations()[0].text
    assert studio.undo()
    assert studio.placement is not None
    studio.pose(0, x=3.0, y=0.2, z=1.0)
    studio.snap(0)
    assert studio.rig.pose(0) | {"x": 1.0, "y": 0.2, "z": 1.6} == studio.rig.pose(0)
    assert not [v for v in studio.violations() if v.limit == "zone"]


def test_several_rigs_stand_side_by_side(studio):
    studio.choose("left handed")
    assert studio.rig.pose(0)["y"] == -0.5
    studio.pose(0, y=0.25)
    assert studio.rig.written["mounts"][0]["y"] == -0.25
    studio.copy_rig("other")
    assert [rig.name for rig in studio.rigs] == ["roof", "left handed", "other"]
    assert studio.numbers(rig=studio.initial) != studio.numbers()


@settings(max_examples=25, derandomize=True)
@given(pose=st.fixed_dictionaries({}, optional={n: st.floats(0, 9) for n in ("x", "z", "yaw")}))
def test_a_saved_file_is_the_same_rigs(tmp_path_factory, pose):
    folder = tmp_path_factory.mktemp("saved")
    studio = studio_of(folder)
    studio.pose(0, **pose)
    path = studio.save(folder / "new.yaml")
    assert read_rigs(path).rigs == studio.rigs
    before, after = parse_yaml(TEXT), parse_yaml(path.read_text())
    original, other = (content.pop("placements")["left handed"] for content in (before, after))
    assert original == other
    assert before == after


def test_save_never_overwrites_unasked(studio):
    before = studio.file.path.read_text()
    studio.pose(0, x=0.7)
    with pytest.raises(FileExistsError, match=r"rigs\.yaml: exists"):
        studio.save()
    assert studio.file.path.read_text() == before
    studio.save(overwrite=True)
    assert read_rigs(studio.file.path).rigs[0].pose(0)["x"] == 0.7


def test_the_file_of_one_placement_stays_one(tmp_path):
    studio = studio_of(tmp_path, "mounts: [{z: 2.0, yaw_deg: 7.5}]\n")
    studio.duplicate(0)
    rig = read_placement(studio.save(overwrite=True), Lidar.paper())
    assert rig.mounts == (Mount.degrees(z=2.0, yaw=7.5), Mount.degrees(y=0.3, z=2.0, yaw=7.5))


def test_a_sweep_of_the_rigs_can_be_planned(studio, scene, tmp_path):
    path = tmp_path / "sweep.yaml"
    assert studio.sweep(path, scene) == f"lidarplace run {path}"
    _, plan = read_plan(path)
    assert {trial.grid_point.point.placement for trial in plan.trials} == {"roof", "left handed"}
    with pytest.raises(FileExistsError):
        studio.sweep(path, scene)
    simulated = scene_of(None)
    assert simulated["source"] == "sumo"
    assert SumoScene(**simulated) == simulated_scene()


def test_no_sweep_is_written_of_a_lidar_in_the_body_or_that_sees_nothing(tmp_path, scene):
    """A sweep itself rejects the same rigs, and the page marks them."""
    path, sky = tmp_path / "sweep.yaml", {"x": 0, "y": 0, "z": 2.6, "lidar": "bpearl"}
    within, outside = {"x": 0, "y": 0, "z": 0.8}, {"x": 5, "y": 0, "z": 0.8}
    rack = {"rack": {"x": [4, 6], "y": [-1, 1], "z": [0, 1]}}
    ahead = sky | {"x": 2.4, "z": 0.6, "pitch_deg": 90}
    big, near = {"lidar": {"size_mm": [400, 400, 400]}}, {"constraints": {"distance": 0.0}}
    for mounts, keys, text in (
        ([ahead, sky], {}, "LiDAR 2: sees no ground and nothing below 2 m"),
        ([sky], {"allow_blind_lidars": False}, "LiDAR 1: sees no ground"),
        (
            [sky | big, ahead | {"x": 0, "z": 2.7}],
            near,
            "LiDAR 2: is inside the housing of LiDAR 1",
        ),
        ([ahead, within], {}, "LiDAR 2: .* m inside of the vehicle's body"),
        ([within], {"vehicle": {"boxes": [[[-1, -1, 0], [1, 1, 1]]]}}, "LiDAR 1: 0.2 m inside"),
        ([outside], {"keep_out": rack}, "LiDAR 1: 0.2 m inside of what is kept out"),
        ([sky], {"allow_blind_lidars": True}, None),
        ([ahead], {}, None),
    ):
        studio = studio_of(tmp_path, {"placements": {"one": {"mounts": mounts}}, **keys})
        if text is None:
            assert not studio.misplaced()
            studio.sweep(path, scene)
            read_plan(path)
            path.unlink()
            continue
        violation, *_ = studio.misplaced()
        assert re.search(text, violation.text)
        with pytest.raises(ValueError, match=rf"^rig 'one': .*{text}"):
            studio.sweep(path, scene)
        with pytest.raises(ValueError, match=text):
            studio.evaluation(path, scene)
        assert not path.exists()
    studio.pose(0, z=2.6, pitch=0)
    studio.enable(0, False)
    with pytest.raises(ValueError, match="sees no ground"):  # mounted, though dead
        studio.sweep(path, scene)


def test_classes_that_have_no_numbers_are_named(tmp_path):
    log = log_of([(8.0, 1.0), (3.0, 4.0)])
    log.boxes.loc[log.boxes["object_id"] == "car 1", "class"] = "Excavator"
    studio = Studio(read_rigs(written(tmp_path)), log, ROI)
    assert studio.left_out == ("Excavator",)
    assert left_out_message(studio).endswith(": Excavator; expected Car")


def test_a_sweep_has_the_vehicle_and_the_requirements_of_the_file(tmp_path, scene):
    ahead = {"name": "cars ahead", "where": {"x": [5, 10], "y": [-2, 2]}}
    content = {
        "vehicle": [[[-2, -1, 0], [2, 1, 1.4]]],
        "placements": {"roof": {"mounts": [{"z": 2.0}]}},
        "requirements": [ahead | {"what": {"class": "Car"}, "at_least": {"points": 10}}],
    }
    studio = studio_of(tmp_path, content)
    studio.sweep(tmp_path / "sweep.yaml", scene)
    swept = read_yaml_file(tmp_path / "sweep.yaml")
    assert swept["requirements"] == content["requirements"]
    sweep, _ = read_plan(tmp_path / "sweep.yaml")
    assert sweep.points[0].vehicle.boxes.tolist() == content["vehicle"]
    opened = yaml.safe_load(rigs_yaml(sweep))
    assert opened["requirements"] == content["requirements"]
    assert RigsSettings(**opened).vehicle == RigsSettings(**content).vehicle


def test_evaluations_are_judged_by_the_generalist_of_the_package(tmp_path, scene):
    mounts = [{"x": 0.4, "z": 2.0}, {"x": -0.4, "z": 2.0}]
    content = {"placements": {"roof": {"mounts": mounts}, "one": {"mounts": mounts[:1]}}}
    studio = studio_of(tmp_path, content)
    path = tmp_path / "evaluation.yaml"
    assert studio.evaluation(path, scene) == Path("runs/evaluation")
    _, plan = read_plan(path)
    assert {trial.grid_point.point.placement for trial in plan.trials} == {"roof", "one"}
    assert {trial.learns.stage.name for trial in plan.trials} == {"pretrained"}
    rigs = [trial.collect_test[0].stage.placement for trial in plan.trials]
    rays = [sum(lidar.rays for lidar in rig.lidars) for rig in rigs]
    assert 0.5 * MOST_RAYS < max(rays) <= 1.01 * MOST_RAYS
    path.write_text(path.read_text() + "training: {score_threshold: 0.2}\n")
    studio.pose(0, x=0.3)
    studio.enable(1, False)
    studio.evaluation(path, scene)
    again = read_yaml_file(path)
    assert len(again["placements"]["roof"]["mounts"]) == 1  # the rig as it works
    assert again["training"] == {"score_threshold": 0.2}
    for broken in ("grid: 3", "surrogate: null", "judge: specialist"):
        path.write_text(f"judge: pretrained\n{broken}\n" if "judge" not in broken else broken)
        with refused(("evaluation.yaml", "", ""), "rename it"):
            studio.evaluation(path, scene)
    path.write_text("judge: generalist\ngeneralist: {rigs: 5}\n")
    studio.evaluation(path, scene)
    _, plan = read_plan(path)
    assert {trial.learns.stage.name for trial in plan.trials} == {"pretrain"}


def test_what_a_sweep_has_found_is_read_from_its_folder(tmp_path):
    tables = tmp_path / "tables"
    tables.mkdir()
    text = "placement,mean,low,high,sd\na,50,40,60,\nb,30,,,\n"
    (tables / "best-recall-0.5-all.csv").write_text(text)
    (tables / "other.csv").write_text("x\n1\n")
    results = found_by_sweep(tmp_path)
    assert list(results) == ["recall 0.5 all"]
    assert results["recall 0.5 all"].loc["a"].tolist() == [50, 40, 60]
    assert math.isnan(results["recall 0.5 all"].loc["b", "low"])
    (tables / "best-ap.csv").write_text("placement,mean\na,1\n")
    with refused(("best-ap.csv", "low, high", "mean")):
        found_by_sweep(tmp_path)


def test_why_an_object_is_not_seen(tmp_path):
    text = "lidar: {beams: 32, azimuth_steps: 1800}\nplacements: {a: {mounts: [{z: 1.7}]}}\n"
    studio = studio_of(tmp_path, text, (8.0, 0.0), (14.0, 0.0), (-9.0, 0.0))  # in line
    table = studio.view.objects(studio.placement).set_index("object_id")
    (hidden,) = studio.why_unseen("car 1")
    assert hidden.stopped.get("car 0", 0) > 0.5 * hidden.aimed
    assert hidden.returned == table["points"]["car 1"]
    assert hidden.aimed == hidden.returned + hidden.dark + sum(hidden.stopped.values())
    (free,) = studio.why_unseen("car 2")
    assert "stopped by car 0" in hidden.text
    assert free.returned == table["points"]["car 2"]
    studio.pose(0, pitch=-60.0)
    (away,) = studio.why_unseen("car 0")
    assert away.aimed == 0
    assert "no ray aims at it" in away.text


def test_corrections_lie_with_the_file_and_lose_what_is_not_seen(tmp_path):
    (tmp_path / "c.yaml").write_text("factor: {Car: 0.25}")
    lidar = "{beams: 32, azimuth_steps: 1800%s}"
    text = f"placements: {{a: {{mounts: [{{z: 1.7, lidar: {lidar}}}]}}}}\n"
    by_correction = []
    for extra in ("", ", correction: c.yaml"):
        studio = studio_of(tmp_path, text % extra, (8.0, 0.0))
        table = studio.view.objects(studio.placement).set_index("object_id")
        (rays,) = studio.why_unseen("car 0")
        assert rays.aimed == rays.returned + rays.dark + rays.lost + sum(rays.stopped.values())
        assert table["points"]["car 0"] == pytest.approx(rays.returned, abs=5 * rays.lost**0.5)
        by_correction.append(rays)
    assert by_correction[0].lost == 0
    assert by_correction[1].returned == pytest.approx(by_correction[0].returned / 4, abs=1)
    assert "about" in by_correction[1].text


def test_blind_ground_is_where_no_ray_passes():
    """Points along dense rays, none of which may be over a cell that is said to be blind."""
    vehicle = Vehicle("van", np.array([[[-2.0, -1.0, 0.0], [2.0, 1.0, 2.0]]]))
    lidar = Lidar.even(8, (-30.0, 0.0), azimuth_steps=720, range=50.0)
    rig = Placement("one", [Mount.degrees(x=1.0, y=0.3, z=2.2, pitch=8.0)], lidar=lidar)
    ground = blind_ground(rig, vehicle, 1.5)
    blind = {tuple(cell) for cell in np.floor(ground.middles / EDGE_M).astype(int).tolist()}
    assert 0.1 < ground.share < 0.9
    far = np.linspace(0.05, 15.0, 1200)
    points = rig.mounts[0].position + (
        far[:, None, None] * (lidar.directions() @ rig.mounts[0].rotation.T)
    )
    low, high = vehicle.boxes[0]
    stopped = np.maximum.accumulate(((points > low) & (points < high)).all(axis=2), axis=0)
    seen_points = points[~stopped & (points[..., 2] > LOWEST_M) & (points[..., 2] < 1.5)]
    seen = {tuple(cell) for cell in np.floor(seen_points[:, :2] / EDGE_M).astype(int).tolist()}
    # A voxel is seen by its middle, so what lies behind an edge of the body may be said blind.
    assert len(seen & blind) < 0.03 * len(seen)
    behind = [cell for cell in blind if cell[0] * EDGE_M < -2.5 and abs(cell[1]) * EDGE_M < 0.5]
    assert behind


def test_the_example_keeps_its_own_constraints():
    file = read_rigs(Path(__file__).parents[3] / "examples/studio.yaml")
    assert [len(rig.lidars) for rig in file.rigs] == [0, 4]
    assert not [violation for rig in file.rigs for violation in violations(rig, file)]
    names = [layout.requirement.name for layout in file.layouts]
    assert names == ["a child ahead", "cyclists in the next lanes"]


def test_pairs_of_sensors_and_prices_of_cameras(tmp_path):
    """Calibration needs a common view; a camera has a price, and goes back into the file."""
    text = """
lidar: {beams: 5, elevation_deg: [-20, 10], azimuth_steps: 90, range: 30}
constraints: {common_view: {pairs: all, share: 0.9}, facing: 0, price: 20}
prices: {vlp16: 4}
placements:
  a:
    mounts:
      - {x: 0.6, y: 0.4, z: 1.8, lidar: vlp16}
      - {x: 0.6, y: -0.4, z: 1.8, lidar: vlp16}
    cameras: [{name: rear, x: -1.7, z: 1.6, yaw_deg: 180, model: a2d2_front_camera, price: 15}]
"""
    studio = studio_of(tmp_path, text)
    violations = {one.limit: one for one in studio.violations()}
    assert set(violations) == {"common_view", "facing", "price"}
    assert violations["facing"].lidars == (0, 1)
    assert violations["facing"].text == "LiDARs 1 and 2: look into each other"
    assert violations["price"].excess == pytest.approx(3)
    assert "and rear: " in violations["common_view"].text
    assert len(violations["common_view"].lidars) == 1
    assert violations["common_view"].excess > 0
    studio.pose(1, z=2.2)
    assert "facing" not in {one.limit for one in studio.violations()}
    assert studio.file.text_with(studio.rigs).count("a2d2_front_camera") == 1
    assert studio.ground("sensors on a child").sensors.max() == 2
    ground = studio.ground("recall of a Car")
    assert ground.recall.mean() == ground.share
    assert 0 < ground.share < 1


def test_numbers_of_lidars_in_all_by_zone_and_by_model(tmp_path):
    text = """
lidars: [4, 5]
counts: {vlp16: [0, 1]}
zones:
  roof: {x: [-1, 1], y: [-0.2, 0.2], z: [1.6, 2.0], standoff: null, lidars: 1}
  side: {x: [0, 1], y: [0.9, 1.1], z: [0.6, 0.9], standoff: null, lidars: [0, 1], mirrored: true,
         models: [bpearl]}
placements:
  a:
    mounts:
      - {x: 0.5, y: 1.0, z: 0.8, lidar: bpearl}
      - {x: 0.5, y: -1.0, z: 0.8, lidar: vlp16}
      - {x: 0.0, y: 0.0, z: 1.8, lidar: vlp16}
"""
    studio = studio_of(tmp_path, text)
    broken = [one.text for one in studio.violations()]
    assert broken == [
        "counts.vlp16: 2 vlp16, expected [0, 1]",
        "lidars: 3 LiDARs, expected [4, 5]",
        "zones.side.models: 1 vlp16, expected 0",
    ]
    studio.model(1, "bpearl")
    studio.add("bpearl")
    studio.pose(3, x=0.3, y=0.1, z=1.8)
    assert [one.text for one in studio.violations()] == ["zones.roof.lidars: 2 LiDARs, expected 1"]


def test_the_answer_of_a_search_keeps_its_bounds(tmp_path):
    """Mirrored pairs and fixed LiDARs are in zones, numbers count, mounts have a price."""
    text = """
mounts:
  - {x: 0.5, y: 1.0, z: 0.8, lidar: bpearl}
  - {x: 0.5, y: -1.0, z: 0.8, lidar: bpearl}
  - {x: 0.0, y: 0.0, z: 1.6, lidar: vlp16}
  - {x: -2.5, z: 0.8, yaw_deg: 180, lidar: vlp16}
search:
  lidars: 3
  models: {dome: {name: bpearl, price: 3, count: 2}, spinner: {name: vlp16, price: 4, count: 1}}
  zones:
    roof: {x: [-1, 1], y: [-0.2, 0.2], z: [1.5, 1.7], lidars: 1,
           models: {spinner: {roll_deg: [0, 5]}}}
    side: {x: [0, 1], y: [0.9, 1.1], z: [0.6, 0.9], lidars: [0, 1], mirrored: true, models: [dome],
           price: 1, facing_deg: 90, yaw_deg: [-95, 0], roll_deg: [-10, 0]}
  pitch_deg: [-5, 5]
  fixed: [{x: -2.5, z: 0.8, yaw_deg: 180, model: spinner}]
  constraints: {price: 16}
"""
    studio = studio_of(tmp_path, text)
    assert not studio.violations()
    studio.pose(1, roll=5.0, yaw=-80.0)  # as of the mirror image
    studio.pose(3, roll=20.0)  # of a fixed one nothing is said
    assert not studio.violations()
    studio.pose(0, roll=5.0, yaw=100.0)
    studio.pose(2, roll=-2.0, pitch=6.0)
    turned = {one.text: one.excess for one in studio.violations()}
    assert turned == {
        "LiDAR 1: roll 5°, in side -10° to 0°": pytest.approx(5.0),
        "LiDAR 1: yaw 100°, in side -5° to 90°": pytest.approx(10.0),
        "LiDAR 3: roll -2°, in roof 0° to 5°": pytest.approx(2.0),
        "LiDAR 3: pitch 6°, in roof -5° to 5°": pytest.approx(1.0),
    }
    for number in (0, 2):
        studio.pose(number, roll=0.0, pitch=0.0, yaw=0.0)
    studio.model(2, "bpearl")
    assert [one.text for one in studio.violations()] == [
        "counts.bpearl: 3 bpearl, expected 2",
        "zones.roof.models: 1 bpearl, expected 0",
    ]
    studio.add("vlp16")
    studio.pose(4, x=0.5, y=1.05, z=0.7)
    assert "price 20: 4 above 16" in [one.text for one in studio.violations()]
