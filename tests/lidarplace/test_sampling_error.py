"""The POG's sampling error against plain loops, and its intervals against a known truth."""

import numpy as np
import pandas as pd
import pytest

from lidarplace import Lidar, Mount, OccupancyGrid, Placement, Roi, evaluate
from lidarplace.logs.box_log import BoxLog
from lidarplace.pog.occupancy.block_counts import BlockCounts
from lidarplace.pog.surrogates.inputs import Sensing
from lidarplace.pog.surrogates.sampling_error import Bootstrap, frame_blocks, pog_sampling_error
from lidarplace.pog.surrogates.table import ASKED_OF_POG

ROI = Roi((0, 20), (-5, 5), (0, 2), 0.5)
LIDAR = Lidar(tuple(np.radians(np.linspace(-25, 5, 8))), azimuth_steps=180)
PLACEMENT = Placement("one", [Mount(z=1.8)], LIDAR)
RAYS = ("expected_points", "expected_ig")


def traffic(rng, frames):
    """Cars that drive through the ROI in ten frames, at random times, on two lanes."""
    rows = []
    for lane in (-2.0, 2.0):
        for start in np.flatnonzero(rng.random(frames + 10) < 0.15) - 10:
            y = lane + rng.normal(0, 0.3)
            for step in range(10):
                if 0 <= start + step < frames:
                    rows.append((start + step, "Car", 2.0 * step, y, 0.75, 4.0, 1.8, 1.5, 0.0))
    columns = ["frame", "class", "x", "y", "z", "length", "width", "height", "yaw"]
    return pd.DataFrame(rows, columns=columns)


def error_of(boxes, frames, sensing=Sensing(), classes=("Car",), placement=PLACEMENT, **bootstrap):
    log, settings = BoxLog(boxes, frames), {"bootstrap": Bootstrap(**bootstrap)}
    return pog_sampling_error(log, ROI, classes, placement, sensing=sensing, **settings)


def table_of(frames, routes=1):
    return pd.DataFrame({"frame": range(frames), "route": np.arange(frames) * routes // frames})


@pytest.mark.parametrize(
    ("q", "occlusion", "method"), [(0.1, False, "cone"), (1.0, False, "dda"), (0.1, True, "cone")]
)
def test_equals_a_log_that_is_put_together_again(q, occlusion, method):
    log, frames = traffic(np.random.default_rng(1), 50), table_of(50, routes=2)
    options = {"detection_probability": q, "occlusion": occlusion}
    found = error_of(log, frames, Sensing(method, q, occlusion), blocks=7, resamples=3, seed=5)
    whole = OccupancyGrid.from_boxes(log, ROI, "Car", 50)
    expected = evaluate(whole, PLACEMENT, method, surrogates=RAYS, **options)
    for name, value in found.estimates.set_index("surrogate")["value"].items():
        assert value == pytest.approx(getattr(expected, name), rel=1e-11)

    block = frame_blocks(frames, 7)
    assert block.max() == 7  # four of each route
    rng = np.random.default_rng(5)
    draws = rng.multinomial(8, np.full(8, 1 / 8), 3)
    for number, draw in enumerate(draws):
        times = np.repeat(np.arange(len(draw)), draw)
        order = [f for b in times for f in np.flatnonzero(block == b)]
        parts = [log[log["frame"] == f].assign(frame=new) for new, f in enumerate(order)]
        grid = OccupancyGrid.from_boxes(pd.concat(parts), ROI, "Car", len(order))
        if occlusion:  # the rays keep the weights of the whole log
            names, expected = RAYS[:1], evaluate(grid, PLACEMENT, method, surrogates=RAYS[:1])
        else:
            names, expected = (
                ASKED_OF_POG,
                evaluate(grid, PLACEMENT, method, surrogates=RAYS, **options),
            )
        own = found.resamples[found.resamples["resample"] == number].set_index("surrogate")["value"]
        for name in names:
            assert own[name] == pytest.approx(getattr(expected, name), rel=1e-11), name


def test_histories_give_the_counts_of_any_mix():
    rng = np.random.default_rng(0)
    blocks = rng.integers(0, 3, (6, 5, 4, 3)).astype(np.int32) * (rng.random((6, 5, 4, 3)) < 0.5)
    histories = BlockCounts.of_blocks(iter(blocks.astype(np.int32)))
    for _ in range(5):
        weights = rng.integers(0, 4, 6)
        expected = np.tensordot(weights, blocks, 1).reshape(-1)
        found = np.zeros(60, np.int64)
        found[histories.voxels] = histories.counts(weights)[histories.history]
        assert np.array_equal(found, expected)


def test_intervals_hold_the_truth_about_as_often_as_they_say():
    rng = np.random.default_rng(0)
    grid = OccupancyGrid.from_boxes(traffic(rng, 20_000), ROI, "Car", 20_000)
    truth = evaluate(grid, PLACEMENT, surrogates=RAYS)
    held, bias = [], []
    for seed in range(40):
        log = traffic(rng, 300)
        error = error_of(log, table_of(300), blocks=10, resamples=60, seed=seed)
        found = error.estimates.set_index("surrogate")
        names = ["s_mig", "expected_points", "expected_ig"]
        value = np.array([getattr(truth, name) for name in names])
        held.append((found.loc[names, "low"] <= value) & (value <= found.loc[names, "high"]))
        bias.append(found.loc["h_pog", "bias"])
    assert np.all(np.mean(held, axis=0) >= 0.8)  # 10 blocks: somewhat below 95 %
    assert np.mean(bias) < 0  # entropies of few frames are too low


def test_a_class_without_objects_has_no_error():
    log = traffic(np.random.default_rng(0), 20)
    found = error_of(log, table_of(20), classes=["Pedestrian"], blocks=4)
    assert (found.estimates[["value", "sd", "bias", "low", "high"]] == 0).all(axis=None)


def test_the_same_draws_for_every_placement():
    log = traffic(np.random.default_rng(0), 40)
    rigs = PLACEMENT, Placement("other", [Mount(z=2.4)], LIDAR)
    found = [error_of(log, table_of(40), placement=rig, resamples=5) for rig in rigs]
    a, b = (f.resamples.query("surrogate == 'h_pog'")["value"].to_numpy() for f in found)
    assert np.array_equal(a, b)
    assert len(set(a)) > 1


def test_blocks_are_consecutive_frames_of_one_route():
    frames = table_of(20, routes=2).iloc[::-1]
    block = pd.Series(frame_blocks(frames, 6), index=frames["frame"]).sort_index()
    assert block.tolist() == sorted(block)
    assert block.value_counts().between(3, 4).all()
    assert set(block[:10]).isdisjoint(block[10:])
