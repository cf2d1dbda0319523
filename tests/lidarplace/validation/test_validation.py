"""A vehicle that loses returns by a known rule: the validation finds the rule, and decides."""

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.clouds import PointClouds, as_kept, write_clouds
from lidarplace.clouds.collect import collect
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.points_in_boxes import count_points_per_object
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.commands.convert import app as convert
from lidarplace.configuration.correction import read_correction
from lidarplace.configuration.vehicle import read_vehicle
from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.validation.decision import decide
from lidarplace.validation.simulation import (
    SECTORS,
    SimulatedRig,
    rays_on_objects,
    sectors_of,
    simulate,
)
from lidarplace.validation.validation import validate
from tests.other_simulator import write_log
from tests.refused import refused
from tests.sweeps.toy import call
from tracking.validation.command import app
from tracking.validation.page import warnings_of, with_world, write_validation

NAMES = ("up", "down")
LIDAR = Lidar.even(beams=32, elevation_deg=(-25, 12), azimuth_steps=1200, range=150.0)
RIG = RecordedRig(NAMES, Placement("vehicle", [Mount(z=2.1), Mount(z=1.8, yaw=0.3)], LIDAR))
SIZES = {"Car": (4.5, 1.9, 1.6), "Cyclist": (1.8, 0.6, 1.7), "Pedestrian": (0.7, 0.7, 1.75)}
KEPT = (-150.0, -150.0, -20.0, 150.0, 150.0, 40.0)


class Loss(NamedTuple):
    """What the vehicle loses."""

    factor: dict[str, float]
    distance: float = np.inf
    shadow: float = 1.0  # share that the lower LiDAR returns in its first six sectors


NOTHING = Loss({})
REAL = Loss({"Car": 0.6, "Cyclist": 0.45, "Pedestrian": 0.8}, distance=75.0, shadow=0.05)


def boxes(routes: int, objects: int, frames: int, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Objects that stand around a vehicle, on ground that is not flat."""
    random = np.random.default_rng(seed)
    rows, listed = [], []
    for route in range(routes):
        names = random.choice(list(SIZES), objects, p=[0.5, 0.25, 0.25])
        turn = (np.arange(objects) + random.uniform(0, 0.5, objects)) / objects * 2 * np.pi
        away, yaw = random.uniform(8, 70, objects), random.uniform(-3, 3, objects)
        ground = random.uniform(-2, 2, objects) * away / 70
        for index in range(frames):
            frame = route * frames + index
            listed.append((f"drive{route}", frame, 0.1 * index, route, "test"))
            for n, name in enumerate(names):
                length, width, height = SIZES[name]
                at = away[n] * np.cos(turn[n] + 0.01 * index), away[n] * np.sin(turn[n])
                rows.append((f"drive{route}", frame, 0.1 * index, f"{route}-{n}", name, *at,
                             ground[n] + height / 2, length, width, height, yaw[n]))  # fmt: skip
    columns = ["scene", "frame", "timestamp_s", "route", "split"]
    return pd.DataFrame(rows, columns=list(BOX_COLUMNS)), pd.DataFrame(listed, columns=columns)


def recorded(
    folder: Path, loss: Loss, routes: int = 4, objects: int = 16, frames: int = 3, seed: int = 1
) -> BoxLog:
    """A log with the points that the vehicle's LiDARs returned, and its clouds in `folder`."""
    table, listed = boxes(routes, objects, frames, seed)
    log = BoxLog(table, listed)
    surroundings, mask = Surroundings(log), np.ones((2, SECTORS))
    mask[1, :6] = loss.shadow
    factor = np.array([loss.factor.get(name, 1.0) for name in table["class"]])
    counts = {name: np.zeros(len(table)) for name in NAMES}
    for scene, of_scene in listed.groupby("scene"):
        clouds = []
        for frame in of_scene["frame"]:
            random = np.random.default_rng(int(frame))
            rows, points, sizes = surroundings.rows(frame), [], []
            parts = body_parts(None).and_(surroundings.parts(frame, 300.0))
            for n, mount in enumerate(RIG.placement.mounts):
                hits = rays_on_objects(mount, LIDAR, parts)
                met = np.zeros(LIDAR.rays, bool)
                met[hits.ray] = True
                away, target = np.full(LIDAR.rays, 80.0), np.zeros(LIDAR.rays, int)
                away[hits.ray], target[hits.ray] = hits.range, hits.target  # the rest is walls
                at = mount.position + LIDAR.directions() @ mount.rotation.T * away[:, None]
                share = mask[n][sectors_of(LIDAR.directions())]
                own_share = factor[rows][target]
                share = share * np.where(met, own_share * np.exp(-away / loss.distance), 1.0)
                returns = random.random(len(at)) < share
                counts[NAMES[n]][rows] = np.bincount(target[returns & met], minlength=len(rows))
                seen = np.c_[at[returns], np.full(returns.sum(), 0.5)].astype(np.float32)
                points.append(as_kept(seen[np.abs(seen[:, 2]) < 19], KEPT))
                sizes.append(len(points[-1]))
            clouds.append((np.concatenate(points), np.array(sizes)))
        packed = PointClouds.from_frames(of_scene["frame"].to_numpy(), clouds, KEPT)
        write_clouds(folder / "clouds" / "recorded" / scene, packed)
    of_each = {f"points/{name}": values for name, values in counts.items()}
    table = table.assign(points=sum(counts.values()), **of_each)
    log = BoxLog(table, listed, rigs=dict.fromkeys(listed["scene"].unique(), RIG))
    write_box_log(folder, log)
    return log


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    folder = tmp_path_factory.mktemp("real")
    return folder, recorded(folder, REAL)


@pytest.fixture(scope="module")
def results(real):
    folder, log = real
    return validate(log, folder)


def test_what_is_lost_is_found_again(results):
    file = results.correction
    for name, share in REAL.factor.items():
        assert file.factor[name] == pytest.approx(share, rel=0.12), name
        low, high = results.intervals[name]
        assert low <= file.factor[name] <= high
    assert 55 <= file.distance <= 115
    assert set(file.lidars) == set(NAMES)
    assert file.lidars["up"].mask is None
    shares = np.array(file.lidars["down"].mask.shares[0])
    np.testing.assert_allclose(shares[:6], 0.05, atol=0.03)
    np.testing.assert_array_equal(shares[6:], 1.0)


def test_all_lidars_have_the_points_of_each(real):
    folder, log = real
    few = replace(log, boxes=log.boxes.assign(points=0.5 * log.boxes["points/up"]))
    with refused((f"{folder}/boxes.parquet", "points", "")):
        validate(few, folder)


def test_it_is_judged_on_routes_that_it_was_not_fitted_to(results):
    every = results.scores[results.scores["by"] == "all"].set_index("model")
    assert every.loc["shipped", "bias"] > 0.7
    assert abs(every.loc["corrected", "bias"]) < 0.1
    assert every.loc["corrected", "spread"] < 0.3 < every.loc["shipped", "spread"]
    assert len(results.fits) == results.routes == 4
    assert results.fits["Car"].nunique() > 1
    decision = decide(results)
    assert decision.answer == "with a correction"
    shipped, corrected, routes = decision.why
    assert shipped.startswith("As shipped")
    assert "left out" in corrected
    assert "single routes" in routes


def test_subsets_of_the_lidars_are_a_placement_experiment(results):
    table = results.subsets.set_index(["measure", "class", "subset"])
    cells = table.loc[("cells", "Car")]
    assert set(cells.index) == {"up", "down", "up + down"}
    np.testing.assert_allclose(cells["corrected"], cells["real"], rtol=0.1)
    assert (cells["shipped"] > 1.1 * cells["real"]).all()
    points = table.loc[("points", "all")]
    np.testing.assert_allclose(points["corrected"], points["real"], rtol=0.1)
    assert points["real"]["up + down"] == pytest.approx(points["real"][["up", "down"]].sum())
    assert (results.agreement["subsets"] == 3).all()


def test_the_reason_of_the_worst_is_known_from_clouds(results):
    fates = ["in the box", "hidden", "passed beyond", "lost"]
    reasons = {*fates[1:], "too few simulated", "hidden in the simulation alone"}
    assert set(results.worst["reason"]) <= reasons
    rays = results.worst[fates].sum(axis=1)
    np.testing.assert_array_equal(rays, results.worst["shipped"])


def test_a_simulator_that_is_right_is_believed_as_it_is(tmp_path):
    results = validate(recorded(tmp_path, NOTHING, frames=2), tmp_path)
    every = results.scores[results.scores["by"] == "all"]
    np.testing.assert_array_equal(every["bias"], 0.0)
    assert decide(results).answer == "yes"
    assert all(unit.mask is None for unit in results.correction.lidars.values())


def test_a_correction_that_was_fitted_to_the_log_that_judges_it_says_so(results):
    why = decide(replace(results, correction_given=True)).why
    assert "fitted to this log" in why[2]
    facts = results.correction.fitted | {"tracks": results.tracks + 1}
    other = results.correction.model_copy(update={"fitted": facts})
    decision = decide(replace(results, correction_given=True, correction=other))
    assert len(decision.why) == len(why) - 1


def test_a_wrong_label_is_left_out(real, results):
    """A van that is not there, before the vehicle in all frames, hides nothing and counts not."""
    folder, log = real
    van = log.boxes.drop_duplicates("frame").assign(
        object_id="van-17", **{"class": "Car"}, x=6.0, y=0.0, z=1.5, length=2.0, width=6.0,
        height=3.0, yaw=0.0, **{column: 0.0 for column in log.boxes if "points" in column},
    )  # fmt: skip
    wrong = replace(log, boxes=pd.concat([log.boxes, van], ignore_index=True))
    mended = validate(wrong, folder, without=["van"])
    pd.testing.assert_frame_equal(mended.scores, results.scores, check_exact=True)
    assert with_world(mended) == "static world for 0 % of the objects; left out: van"
    for name, names in (("bus", "none"), ("", "none"), ("0-", "0-0, 0-1, …")):
        with refused(("boxes.parquet", "object_id", names), f"'{name}'"):
            validate(wrong, folder, without=[name])


def test_clouds_of_the_corrected_rig_have_the_real_points(real, results):
    """Above z = 0, where the clouds' ground hides nothing of the boxes."""
    _, log = real
    named = zip(NAMES, RIG.placement.lidars, strict=True)
    lidars = [lidar.corrected(results.correction, name) for name, lidar in named]
    high = log.boxes[log.boxes["z"] > log.boxes["height"] / 2]
    ratio = {}
    for name, rig in (("shipped", RIG.placement), ("corrected", RIG.placement.with_lidar(lidars))):
        clouds = collect(log, log.frames["frame"], rig, (-80, -80, -5, 80, 80, 10))
        points = count_points_per_object(high, clouds)["points"]
        ratio[name] = points.sum() / high["points"].sum()
    assert ratio["shipped"] > 1.8
    assert ratio["corrected"] == pytest.approx(1.0, abs=0.08)


def test_few_tracks_give_one_number_and_no_decision(tmp_path):
    results = validate(recorded(tmp_path, REAL, routes=2, objects=10, frames=2), tmp_path)
    assert results.tracks <= 20
    assert list(results.correction.factor) == ["other"]
    assert results.correction.distance is None
    decision = decide(results)
    assert decision.answer == "no"
    assert "Too few tracks" in decision.why[0]
    few = replace(results, scores=results.scores.query("by == 'all'"))  # no group of 20 objects
    page = write_validation(tmp_path / "page.html", "few", few, decision)
    assert "No: do not trust the simulator" in page.read_text(encoding="utf-8")


def test_points_of_the_worst_objects_lie_over_each_other(results, real):
    _, log = real
    boxes = log.boxes.reset_index(drop=True)
    assert len(results.overlays) == 6
    for overlay, row in zip(results.overlays, results.worst.to_dict("index").items(), strict=False):
        (number, worst), half = row, overlay.size / 2
        inside = (np.abs(overlay.real) <= half + 1e-3).all(axis=1)
        assert inside.sum() == pytest.approx(worst["real"], abs=2)
        assert len(overlay.simulated) == worst["shipped"]
        assert (np.abs(overlay.simulated) <= half + 1e-3).all()
        place = boxes.loc[number, ["x", "y", "z"]].to_numpy(float)
        assert np.linalg.norm(overlay.origin) == pytest.approx(np.linalg.norm(place))


def test_a_shadow_that_is_wider_than_a_vehicle_is_a_cropped_cloud(results):
    assert not warnings_of(results)
    half = np.ones((2, SECTORS))
    half[0, :20] = half[0, -16:] = 0.0  # 36 sectors behind, through ±180 degrees
    (warning,) = warnings_of(replace(results, shadows=half))
    assert warning.startswith("up: almost no returns over 180° of azimuth.")
    assert "cropped" in warning
    half[0] = np.arange(SECTORS) % 2  # as much, but nowhere in one piece
    assert not warnings_of(replace(results, shadows=half))


def test_ground_hides_nothing(real):
    """Boxes under z = 0 are seen as those above it."""
    _, log = real
    frames = log.frames["frame"].tolist()[:2]
    sunk = replace(log, boxes=log.boxes.assign(z=log.boxes["z"] - 3.0))
    lower = [replace(mount, z=mount.z - 3.0) for mount in RIG.placement.mounts]
    high = simulate(SimulatedRig(log, RIG.placement), frames)
    low = simulate(SimulatedRig(sunk, replace(RIG.placement, mounts=lower)), frames)
    # The own body stays where it is, and hides other rays.
    assert low.points.sum() == pytest.approx(high.points.sum(), rel=0.1)


def test_what_cannot_be_compared_is_one_line(real):
    folder, log = real
    boxes, other = log.boxes, RIG.subset(["up"])
    lone = boxes.drop(columns=["points/up", "points/down"]).assign(points=0.0)
    lone.loc[boxes["object_id"] == "0-0", ["points", "z"]] = 30.0, 500.0
    for (name, *place), message, change in (
        (("boxes.parquet", "points", "none"), "", {"boxes": boxes.drop(columns="points")}),
        (("boxes.parquet", "", "no boxes"), "", {"boxes": boxes.iloc[:0]}),
        (("rig.json", "scene drive0", "0"), "", {"rigs": {}}),
        (("boxes.parquet", "points", "0 of every box"), "", {"boxes": boxes.assign(points=0.0)}),
        (("boxes.parquet", "", ""), "real and sim", {"boxes": lone}),
        (("rig.json", "", ""), "drive0 and drive1", {"rigs": {**log.rigs, "drive1": other}}),
        (("boxes.parquet", "points", "roof"), "", {"boxes": boxes.assign(**{"points/roof": 1.0})}),
    ):
        with refused((f"{folder}/{name}", *place), message):
            validate(replace(log, **change), folder)


def test_the_verb_writes_page_tables_and_a_correction(real, tmp_path):
    folder, log = real
    out = tmp_path / "out"
    result = call(app, folder, "--out", out)
    assert "with a correction" in result.output
    page = (out / "validation.html").read_text(encoding="utf-8")
    answer, first = page.index("Yes, with a correction"), page.index("<h2>")
    assert answer < first
    assert page.count("barpolar") >= 2
    assert read_correction(out / "correction.yaml").factor["Car"] == pytest.approx(0.6, rel=0.12)
    scores = pd.read_parquet(out / "scores.parquet")
    assert set(scores["by"]) == {"all", "distance", "class", "route"}
    options = ["--correction", str(out / "correction.yaml")]
    again = call(app, folder, "--out", out, *options)
    assert "With the correction, as given, every check is met." in again.output
    assert len(pd.read_parquet(out / "fits.parquet")) == 0, "it is judged without a fit"
    empty = tmp_path / "empty"
    write_box_log(empty, replace(read_box_log(folder), boxes=log.boxes.drop(columns="points")))
    wrong = call(app, empty, "--out", out, code=2)
    assert len(wrong.output.strip().splitlines()) == 1


MOUNTED = """
mounts:
- {name: top, z: 2, lidar: &l {beams: 14, elevation_deg: [-24, 2], azimuth_steps: 300, range: 80}}
- {name: low, x: 2.6, z: 0.6, lidar: *l}
"""


def test_a_world_that_convert_built_stops_simulated_rays(tmp_path):
    """A third of the cars is behind a wall without a label, in clouds of another simulator."""
    write_log(tmp_path / "source", frames=8, behind=3)
    (tmp_path / "rig.yaml").write_text(MOUNTED)
    clouds = ["--rig", f"{tmp_path}/rig.yaml", "--clouds", f"{tmp_path}/source/sweeps"]
    scores, behind = {}, {}
    for name, more in (("open", []), ("world", ["--world"])):
        log, out = str(tmp_path / name), tmp_path / f"{name}_out"
        result = call(convert, "table", f"{tmp_path}/source", log, *clouds, *more)
        assert ("static world" in result.output) == bool(more)
        result = call(app, log, "--out", str(out))
        says = f"static world for {100 * len(more)} % of the objects"
        assert says in result.output
        assert says in (out / "validation.html").read_text(encoding="utf-8")
        table = pd.read_parquet(out / "scores.parquet")
        scores[name] = table[(table["by"] == "all") & (table["model"] == "corrected")].iloc[0]
        objects = pd.read_parquet(out / "objects.parquet")
        assert (objects["world"] == bool(more)).all()
        behind[name] = objects.loc[objects["y"] < -12, "points/corrected"].sum()
    assert scores["open"]["rho"] < 0.6
    assert scores["world"]["rho"] > 0.85
    assert abs(scores["world"]["ratio"] - 1) < 0.15
    assert behind["world"] < 0.05 * behind["open"]


def test_the_body_of_the_vehicle_is_the_users(real, tmp_path):
    """A plate before the lower LiDAR's nose stops rays that a sedan does not."""
    folder, log = real
    body = tmp_path / "body.yaml"
    body.write_text("[[[-2, -3, 0.2], [2, 3, 1.6]]]")
    wide = read_vehicle(body)
    frames = log.frames["frame"].tolist()[:2]
    rigs = (SimulatedRig(log, RIG.placement, 0, vehicle) for vehicle in (None, wide))
    sedan, wide_body = (simulate(rig, frames) for rig in rigs)
    assert wide_body.points.sum() < 0.9 * sedan.points.sum()
    body.write_text("{boxes: [[[0, 0, 0], [1, 1]]]}")
    wrong = call(app, str(folder), "--vehicle", str(body), code=2)
    assert wrong.output.startswith(f"{body}: boxes[0]")
    assert len(wrong.output.strip().splitlines()) == 1


PERFECT = {"by": "all", "bias": 0.0, "spread": 0.0, "within_2": 1.0, "rho": 1.0, "real_5": 0.5,
           "simulated_5": 0.5}  # fmt: skip


def judged(results, shipped, corrected=None, **facts):
    models = {"shipped": shipped, "corrected": corrected or {}}
    rows = [{"model": model} | PERFECT | changes for model, changes in models.items()]
    return decide(replace(results, scores=pd.DataFrame(rows), **facts))


@pytest.mark.parametrize(
    ("column", "met", "failed", "says"),
    [
        ("bias", 0.1, 0.11, "median object has 1.08 times"),
        ("bias", -0.1, -0.11, "median object has 0.93 times"),
        ("spread", 0.5, 0.51, "off by more than a factor 1.42"),
        ("within_2", 0.75, 0.74, "74 % of objects"),
        ("rho", 0.85, 0.84, "rank correlation over objects is 0.84"),
        ("bias", 0.1, math.nan, "no object has 5 simulated points"),
        ("simulated_5", 0.549, 0.56, "at least 5 points is off by +6.0 %"),
        ("simulated_5", 0.451, 0.44, "at least 5 points is off by −6.0 %"),
    ],
)
def test_every_limit_decides(results, column, met, failed, says):
    assert judged(results, {column: met}).answer == "yes"
    mended = judged(results, {column: failed})
    assert mended.answer == "with a correction"
    assert says in mended.why[0]
    worse = judged(results, {column: failed}, {column: failed})
    assert worse.answer == "no"
    assert says in worse.why[1]


def test_too_little_data_is_no(results):
    assert judged(results, {}, tracks=40).answer == "yes"
    assert judged(results, {}, tracks=39).answer == "no"
    one = judged(results, {"rho": 0.5}, routes=1)
    assert one.answer == "no"
    assert "one route" in one.why[1]
    as_given = judged(results, {"rho": 0.5}, routes=1, correction_given=True)
    assert as_given.answer == "with a correction"
