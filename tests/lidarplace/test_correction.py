"""Corrections: the law of what returns, alike in clouds, expected recall and requirements."""

import json
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount, Placement, Roi
from lidarplace.clouds.collect import collect
from lidarplace.clouds.ground import Ground
from lidarplace.clouds.raycast import GROUND, expected_share
from lidarplace.clouds.recorded import check_rig, rig_record
from lidarplace.clouds.returns import CloudPart, sample_points
from lidarplace.clouds.shapes import SIGN
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.configuration import correction as files
from lidarplace.configuration.correction import CorrectionFile, read_correction, write_correction
from lidarplace.configuration.placement import read_placement
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.requirements.rays_on_objects import at_class, count_cells, count_points, sights_of
from lidarplace.rig_files.carla import write_carla
from lidarplace.rig_files.mounts_yaml import read_mounts_yaml
from lidarplace.rigs.correction import Correction, Mask
from lidarplace.rigs.pose import rotation
from lidarplace.rigs.scan_pattern import ScanPattern
from lidarplace.validation.fit import Fit
from lidarplace.validation.validation import _file
from sweeps.stages.task import plain
from tests.lidarplace.from_a_car import cast
from tests.lidarplace.recall.small_scenes import log_of
from tests.lidarplace.requirements.brute_force import hits_of
from tests.lidarplace.test_collect import CROP, log
from tests.refused import refused

LIDAR = Lidar(tuple(np.radians(np.linspace(-25, 5, 16))), azimuth_steps=1800)
MASK = Mask(((0.2, 1.0, 0.7, 0.4), (0.9, 0.1, 0.5, 1.0)), (-0.1,))
LOSSY = Correction((("Car", 0.5), ("Pedestrian", 1.7), ("other", 0.3)), 30.0, MASK)
MOUNT = Mount(z=2.2, yaw=0.4)
WIDE = (-100.0, -100.0, -1.0, 100.0, 100.0, 9.0)
NOBODY = Vehicle("nobody", np.empty((0, 2, 3)))
FILE = """
factor: {Car: 0.62, other: 0.6}
distance: 75.0
lidars:
  up: {azimuth_steps: 1811, mask: {azimuth_deg: 90, shares: [1, 0.5, 1, 0.2]}}
  down: {mask: {azimuth_deg: 180, elevation_deg: [-5], shares: [[1, 0.5], [0.1, 1]]}}
fitted: {routes: 4, below_m: 75}
"""


def test_a_fit_lists_the_classes_of_its_log(tmp_path):
    fit = Fit({"other": 1.0, "Car": 0.9, "Truck": 0.8}, None)
    fitted = _file(fit, ["up"], None, {"tracks": 50})
    write_correction(path := tmp_path / "c.yaml", fitted)
    assert read_correction(path) == fitted
    assert fitted.classes == ("Truck",)
    path.write_text(path.read_text().replace("classes", "# classes"))
    with refused("factor: Truck is not among classes"):
        read_correction(path)


def corrected(correction, **other) -> Lidar:
    return replace(LIDAR, correction=correction, **other)


def share(lidar, name, direction, distance) -> float:
    """Probability of a return, in plain Python."""
    correction, factors = lidar.correction, dict(lidar.correction.factor)
    chance = 1.0
    if name is not None:
        chance = factors.get(name, factors.get("other", 1.0))
        chance *= math.exp(-distance / (correction.distance or math.inf))
    if correction.mask is not None:
        x, y, z = direction
        rows = correction.mask.shares
        row = sum(math.asin(z) >= edge for edge in correction.mask.edges)
        turn = (math.degrees(math.atan2(y, x)) + 180 + 1e-7) % 360
        chance *= rows[row][int(turn * len(rows[row]) / 360)]
    return min(chance, 1.0) * (1 - lidar.drop_off)


def returned(lidar, hits, classes, ground, key):
    """Rows of the points that return."""
    points = np.empty((lidar.rays, 4), np.float32)
    count = sample_points(MOUNT, lidar, hits, ground, WIDE, CloudPart(key, 0.0, classes), points)
    return points[:count]


def sampled(lidar):
    """Hits of a frame, classes of its objects, and rows of the points that return."""
    surroundings = Surroundings(log())
    hits = cast(MOUNT, lidar, surroundings.parts(0, 100.0))
    ground, classes = surroundings.ground(0), surroundings.classes(0)
    return hits, classes, returned(lidar, hits, classes, ground, (0, 0, 0))


@pytest.mark.parametrize("drop_off", [0.0, 0.3])
def test_rays_return_as_often_as_the_law_says(drop_off):
    lidar = corrected(LOSSY, drop_off=drop_off)
    hits, classes, _ = sampled(lidar)
    seen = np.flatnonzero(hits.target >= SIGN)
    names = [classes[t] if t >= 0 else None for t in hits.target[seen]]
    each = zip(names, lidar.directions()[seen], hits.range[seen], strict=True)
    chance = np.array([share(lidar, *ray) for ray in each])
    draws, ground = 15, Ground(np.ones((1024, 1024), np.float32), (0.0, 0.0, 0.0))
    for name in (None, "Car", "Cyclist", "Pedestrian"):
        of_class = np.array([other == name for other in names])
        assert of_class.sum() > 50
        targets = np.where(np.isin(np.arange(lidar.rays), seen[of_class]), hits.target, -5)
        only, p = hits._replace(target=targets), chance[of_class]
        each = (returned(lidar, only, classes, ground, (7, draw, 0)) for draw in range(draws))
        returns = sum(map(len, each))
        assert abs(returns - draws * p.sum()) < 5 * math.sqrt(draws * (p * (1 - p)).sum())


def test_what_a_correction_leaves_is_part_of_what_returns_without():
    whole, fewer = ([*map(bytes, sampled(lidar)[2])] for lidar in (LIDAR, corrected(LOSSY)))
    assert 0 < len(fewer) < 0.8 * len(whole)
    assert {*fewer} <= {*whole}


@pytest.mark.parametrize("drop_off", [0.0, 0.1, 0.3])
@pytest.mark.parametrize(
    "nothing",
    [
        Correction(),
        Correction((("Car", 1.0), ("other", 1.0)), None, Mask(((1.0,),))),
        Correction((("Car", 3.0),), None, Mask(((1.0, 1.0), (1.0, 1.0)), (0.1,))),
    ],
)
def test_a_correction_of_ones_changes_no_bit(nothing, drop_off):
    noisy = replace(LIDAR, range_noise=0.02, drop_off=drop_off)
    lidars = noisy, replace(noisy, correction=nothing)
    rigs = [Placement("a", [MOUNT, Mount(x=0.5, z=2.4)], lidar) for lidar in lidars]
    before, after = (collect(log(), range(3), rig, CROP) for rig in rigs)
    for key, array in before.arrays().items():
        np.testing.assert_array_equal(array, after.arrays()[key])
    objects = counted(log())
    before, after = objects.seen_by(rigs)
    np.testing.assert_array_equal(before.cells, after.cells)
    np.testing.assert_array_equal(before.points, after.points)
    box = np.array([[12.0, 1.0, 0.8, 4.4, 1.8, 1.6, 0.3]])
    sets = [(0, 1), (0,), (1,)]
    for count in (partial(count_points, sets=sets), partial(count_cells, cell=0.2, sets=sets)):
        before, after = (count(sights_of(rig, NOBODY), box) for rig in rigs)
        np.testing.assert_array_equal(before, after)


def counted(box_log, classes=("Car", "Cyclist", "Pedestrian"), seed=0) -> CountedObjects:
    roi = Roi((0, 60), (-30, 30), (0, 9), resolution=0.5)
    return CountedObjects.from_log(box_log, roi, classes, 0.2, seed=seed)


def test_clouds_and_expected_recall_keep_the_same_rays():
    """Of one LiDAR, without noise: as many points on every object, to the last one."""
    rows = [(frame, "Car", 15.0, 3.0 * y, 2.0, 2.0, 2.0, 0.3) for frame in (0, 4) for y in (-2, 1)]
    box_log = log_of(*rows)
    lidar = replace(LIDAR, correction=LOSSY, drop_off=0.1)
    rig = Placement("a", [MOUNT], lidar)
    seen = counted(box_log, ["Car"], seed=3).seen_by([rig])[0]
    clouds = collect(box_log, [0, 4], rig, (0, -30, 0.01, 60, 30, 9), seed=3)
    assert seen.points.sum() > 50
    assert [seen.points[:2].sum(), seen.points[2:].sum()] == clouds.counts[:, 0].tolist()


def test_requirements_expect_what_draws_have_in_the_mean():
    draws, box = 400, (12.0, 2.0, 4.4, 1.8, 1.6, 0.3)
    box_log = log_of(*[(frame, "Truck", *box) for frame in range(draws)])
    lidar = corrected(Correction((("Truck", 0.6), ("other", 0.1)), 40.0, MASK), drop_off=0.1)
    rig = Placement("a", [MOUNT], lidar)
    seen = counted(box_log, ["Truck"]).seen_by([rig])[0]
    placed = np.array([[*box[:2], 0.8, *box[2:]]])
    sights = at_class(sights_of(rig, Vehicle.car()), rig, "Truck")
    points, cells = count_points(sights, placed), count_cells(sights, placed, 0.2)
    for counts, expected in ((seen.points, points), (seen.counts(), cells)):
        assert len(counts) == draws
        assert abs(counts.mean() - expected[0, 0]) < 5 * counts.std() / math.sqrt(draws)


@settings(max_examples=10)
@given(
    x=st.floats(4, 15),
    yaw=st.floats(-3, 3),
    distance=st.floats(1e-3, 100),
    factors=st.lists(st.floats(0, 2), min_size=3, max_size=3),
)
def test_expected_cells_are_those_of_single_rays(x, yaw, distance, factors):
    few = replace(LIDAR, azimuth_steps=150)
    mounts = [Mount(z=2.1), Mount(x=0.3, z=2.0, roll=0.05), Mount(y=0.5, z=1.9, yaw=1.0)]
    lidars = [replace(few, correction=Correction((("Car", f),), distance)) for f in factors]
    rig = Placement("a", mounts, lidars)
    box = np.array([[x, 0.7, 0.8, 4.4, 1.8, 1.6, yaw]])
    turn = rotation(0, 0, -yaw)
    missed, points = [{} for _ in mounts], np.zeros(3)
    for number, hits in enumerate(hits_of(rig, NOBODY, box[0])):
        local = turn @ (mounts[number].position - box[0, :3]) + box[0, 3:6] / 2
        for hit in hits:
            away = float(np.linalg.norm(np.array(hit) - local))
            p = min(factors[number] * math.exp(-away / distance), 1.0)
            points[number] += p
            slices = np.maximum(np.ceil(box[0, 3:6] / 0.2 - 1e-9), 1) - 1
            cell = tuple(np.clip(np.floor(np.array(hit) / 0.2), 0, slices).astype(int))
            missed[number][cell] = missed[number].get(cell, 1.0) * (1 - p)
    sights = at_class(sights_of(rig, NOBODY), rig, "Car")
    counts = count_points(sights, box, sets=[(0,), (1,), (2,)])
    np.testing.assert_allclose(counts[0], points, rtol=1e-9, atol=1e-12)

    def expected(numbers) -> float:
        cells = {cell for number in numbers for cell in missed[number]}
        return sum(1 - math.prod(missed[n].get(cell, 1.0) for n in numbers) for cell in cells)

    sets = [(0, 1, 2), (1, 2), (0, 2), (0, 1)]
    cells = count_cells(sights, box, 0.2, sets=sets)[0].tolist()
    assert cells == pytest.approx(list(map(expected, sets)), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    "lost", [Correction((("other", 0.0),)), Correction(distance=1e-9), Correction(distance=1e-300)]
)
def test_nothing_returns_from_objects_and_all_from_the_ground(lost):
    hits, _, points = sampled(corrected(lost))
    assert len(points) == (hits.target == GROUND).sum() > 1000
    assert counted(log()).seen_by([Placement("a", [MOUNT], corrected(lost))])[0].points.sum() == 0


def test_a_mask_is_of_all_that_is_hit_and_of_the_sensor_frame():
    half = corrected(Correction(mask=Mask(((0.5,),))))
    hits, _, points = sampled(half)
    number = (hits.target >= SIGN).sum()
    assert abs(len(points) / number - 0.5) < 5 * 0.5 / math.sqrt(number)
    back = Correction(mask=Mask(((0.0, 0.0, 0.0, 1.0),)))  # 90 to 180 degrees alone
    rig = Placement("a", [Mount(z=2.2, yaw=-0.75 * math.pi)], corrected(back))
    cloud = collect(log(), [0], rig, WIDE)[0]
    assert len(cloud) > 500
    azimuth = np.degrees(np.arctan2(cloud[:, 1], cloud[:, 0]))
    assert np.abs(azimuth).max() < 45.1


@given(st.floats(-10, 10), st.floats(-1.5, 1.5), st.integers(1, 90), st.integers(-3, 3))
def test_bins_of_a_mask_go_round(azimuth, elevation, bins, turns):
    """The same share a turn further, and that of the bin that holds the direction."""
    shares = tuple((k + 1) / bins for k in range(bins))
    mask = Mask((shares, tuple(0.5 * value for value in shares)), (0.2,))
    at_direction = mask.at(np.array(azimuth), np.array(elevation))
    width = 2 * math.pi / bins
    place = ((azimuth + math.pi) % (2 * math.pi)) / width
    near = abs(place - round(place)) < 1e-6
    low = shares[int(place) % bins] * (0.5 if elevation >= 0.2 else 1.0)
    assert near or at_direction == low
    further = mask.at(np.array(azimuth + 2 * math.pi * turns), np.array(elevation))
    assert near or further == at_direction
    for end in (-math.pi, math.pi):  # one direction, in the first bin
        assert mask.at(np.array(end), np.array(0.0)) == shares[0]


def test_a_pattern_is_masked_by_its_own_azimuths():
    rng = np.random.default_rng(0)
    pattern = ScanPattern(rng.uniform(-3, 3, 6000), rng.uniform(-0.4, 0.0, 6000), 3000)
    left = Correction(mask=Mask(((0.0, 1.0),)))
    lidars = Lidar.patterned(pattern), Lidar.patterned(pattern, correction=left)
    rigs = (Placement("a", [Mount(z=2.2)], lidar) for lidar in lidars)
    whole, masked = (collect(log(), [1], rig, WIDE)[0] for rig in rigs)
    np.testing.assert_array_equal(whole[whole[:, 1] > 1e-3], masked)


def test_a_share_of_single_rays_is_that_of_the_law():
    lidar = corrected(LOSSY, drop_off=0.2)
    rays, ranges = np.array([0, 700, 20_000]), np.array([1.0, 20.0, 50.0])
    directions = lidar.directions()[rays]
    for name in ("Car", "Tram"):
        expected = [share(lidar, name, *ray) for ray in zip(directions, ranges, strict=True)]
        shares = expected_share(lidar, name, rays, ranges)
        np.testing.assert_allclose(shares, expected, rtol=1e-12)


def test_a_file_is_read_written_and_applied(tmp_path):
    path = tmp_path / "our car.yaml"
    path.write_text(FILE)
    file = read_correction(path)
    up = Lidar.named("vlp32c").corrected(file, unit="up")
    assert up.azimuth_steps == 1811
    mask = Mask(((1.0, 0.5, 1.0, 0.2),))
    assert up.correction == Correction((("Car", 0.62), ("other", 0.6)), 75.0, mask)
    assert "Car 0.62, other 0.6, distance 75 m, mask" in repr(up)
    fleet = Lidar.named("vlp32c").corrected(file)
    assert (fleet.azimuth_steps, fleet.correction.mask) == (1808, None)
    assert up.thinned(0.5).correction == up.correction
    files.write_correction(tmp_path / "again.yaml", file)
    assert read_correction(str(tmp_path / "again.yaml")) == file
    path.write_text("distance: 50")
    assert read_correction(path) == CorrectionFile(distance=50.0), "read again when changed"
    for name in files.packaged():
        read_correction(name)


def test_settings_take_it_beside_their_file(tmp_path):
    (tmp_path / "c.yaml").write_text(FILE)
    (tmp_path / "rig.yaml").write_text(
        "mounts: [{z: 2, lidar: {name: vlp16, correction: c.yaml, unit: down}}, {x: 1, z: 2}]"
    )
    rig = read_placement(tmp_path / "rig.yaml", LIDAR)
    assert rig.lidars[0].correction.mask.edges == (math.radians(-5),)
    assert rig.lidars[1].correction is None
    (mounted, _) = read_mounts_yaml(tmp_path / "rig.yaml")
    assert mounted.model.correction == str(tmp_path / "c.yaml")
    with refused(("lidar_1", "correction", "")):
        write_carla(tmp_path / "objects.json", [mounted])


def test_keys_of_results_have_the_content_not_the_path(tmp_path):
    def text(name: str, content: str) -> str:
        (tmp_path / name).write_text(content)
        rig = Placement("a", [MOUNT], SensorSettings(correction=str(tmp_path / name)).lidar())
        return json.dumps(rig, sort_keys=True, allow_nan=False, default=plain)

    assert text("a.yaml", FILE) == text("b.yaml", FILE)
    assert text("a.yaml", FILE) != text("b.yaml", FILE.replace("75.0", "76.0"))


def test_records_of_rigs_have_it_and_recorded_clouds_do_not_ask(tmp_path):
    rig, lossy = (Placement("a", [MOUNT], lidar) for lidar in (LIDAR, corrected(LOSSY)))
    assert "correction" not in rig_record(rig)["lidars"][0], "as folders from before have it"
    check_rig(tmp_path, rig)  # nothing says otherwise
    (tmp_path / "placement.json").write_text(json.dumps(rig_record(lossy), allow_nan=False))
    check_rig(tmp_path, rig)
    check_rig(tmp_path, lossy)
