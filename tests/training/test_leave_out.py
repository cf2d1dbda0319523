"""AP and recall without each route or individual, against evaluations of what is left."""

import numpy as np
import pandas as pd
import pytest

from lidarplace.base.metrics import EVERY_IOU, MEAN_AP_IOU
from lidarplace.logs.boxes import GEOMETRY
from tests.training.plain_curve import plain_curve
from training.average_precision import COUNTS
from training.kitti_ap import evaluate_boxes, evaluation
from training.leave_out import MOST_UNITS

CLASSES = ["Car", "Cyclist", "Pedestrian"]
KEYS = ["class", "metric", "iou"]


def scene(random, frames, routes, spread, individuals=8):
    """Ground truth, detections that jitter around it and scatter, and the routes of the frames.

    With a small `spread` objects and detections overlap each other, and scores are tied.
    """
    truths, detected = [], []
    for frame in range(frames):
        for k in range(individuals):
            if random.random() < 0.6:
                box = [*random.uniform(-spread, spread, 2), 0.8, 4.0, 2.0, 1.6, 0.0]
                name = CLASSES[k % 3]
                key = f"{frame * routes // frames}-{k}"
                truths.append(("s", frame, key, name, *box))
                for _ in range(random.integers(0, 3)):
                    shifted = [*(box[:2] + random.normal(0, 0.25, 2)), *box[2:]]
                    detected.append((frame, name, *shifted, round(random.random(), 1)))
        for _ in range(random.integers(0, 3)):
            alarm = [*random.uniform(-spread, spread, 2), 0.8, 4.0, 2.0, 1.6, 0.0]
            detected.append((frame, "Car", *alarm, round(random.random(), 1)))
    numbers = np.arange(frames)
    table = pd.DataFrame({"scene": "s", "frame": numbers, "route": numbers * routes // frames})
    return (
        pd.DataFrame(truths, columns=["scene", "frame", "object_id", "class", *GEOMETRY]),
        pd.DataFrame(detected, columns=["frame", "class", *GEOMETRY, "score"]),
        table,
    )


def overlaps(truths, detected):
    """IoU of the boxes of `scene`, in 3D and from above: they differ in x and y alone."""
    apart = np.abs(truths[["x", "y"]].to_numpy()[:, None] - detected[["x", "y"]].to_numpy())
    common = np.maximum(np.array([4.0, 2.0]) - apart, 0).prod(axis=-1)
    return common / (16 - common)


def areas(truths, detected):
    """Area under the precision at every hit of Car, percent, by metric and IoU: plain Python."""
    truths, detected = (table[table["class"] == "Car"] for table in (truths, detected))
    frames = []
    for frame in {*truths["frame"], *detected["frame"]}:
        frame_truths, near = (table[table["frame"] == frame] for table in (truths, detected))
        roles = ([COUNTS] * len(frame_truths), [COUNTS] * len(near))
        frames.append((overlaps(frame_truths, near), near["score"].to_numpy(), *roles))
    of_iou = {
        iou: 100 * plain_curve(frames, iou, len(truths) + 1)[0][:-1].mean() for iou in MEAN_AP_IOU
    }
    single = {(f"AP_R40_{view}", iou): of_iou[iou] for view in ("3D", "BEV") for iou in (0.5, 0.7)}
    return single | {("AP_R40_3D_mean", EVERY_IOU): np.mean([*of_iou.values()])}


def without_ap(values):
    """Metrics that are no AP."""
    return {key: value for key, value in values.items() if not key[1].startswith("AP")}


def by_key(table):
    return table.set_index(KEYS)["value"].to_dict()


def assert_areas(values, truths, detected):
    for (metric, iou), area in areas(truths, detected).items():
        assert values["Car", metric, iou] == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize("spread", [3.0, 40.0])
def test_without_a_route_it_is_the_evaluation_of_the_others(spread):
    """Holds in crowds and with equal scores, too, as a route has whole frames."""
    random = np.random.default_rng(3)
    truths, detected, routes = scene(random, 40, 4, spread)
    frames = routes["frame"].tolist()
    left_out = evaluation(truths, detected, routes, CLASSES).left_out
    assert set(left_out["unit"]) == {"route", "individual", "half", "nothing"}
    whole = by_key(left_out[left_out["unit"] == "nothing"])
    every = by_key(evaluate_boxes(truths, detected, frames, CLASSES))
    assert without_ap(whole) == pytest.approx({k: every[k] for k in without_ap(whole)}, rel=1e-14)
    assert_areas(whole, truths, detected)
    for route in range(4):
        others = routes.loc[routes["route"] != route, "frame"].tolist()
        expected = by_key(evaluate_boxes(truths, detected, others, CLASSES))
        of_route = left_out[left_out["left_out"] == f"s {route}"]
        assert without_ap(by_key(of_route)) == pytest.approx(without_ap(expected), rel=1e-14)
        assert_areas(by_key(of_route), *(t[t["frame"].isin(others)] for t in (truths, detected)))
        gone = truths.loc[~truths["frame"].isin(others), "class"]
        per_class = gone.value_counts().to_dict() | {"all": len(gone)}
        assert (of_route["ground_truths"] == of_route["class"].map(per_class)).all()


def test_a_half_left_out_is_the_evaluation_of_the_other():
    random = np.random.default_rng(5)
    truths, detected, routes = scene(random, 40, 4, 3.0)
    left_out = evaluation(truths, detected, routes, CLASSES).left_out
    halves = left_out[left_out["unit"] == "half"]
    sides = {name: by_key(half_table) for name, half_table in halves.groupby("left_out")}
    assert sorted(sides) == ["0a", "0b", "1a", "1b", "2a", "2b"], "four routes have three splits"
    expected = []
    for split in (({0, i}, {1, 2, 3} - {i}) for i in (1, 2, 3)):
        frames = (routes.loc[routes["route"].isin(half), "frame"].tolist() for half in split)
        expected.append(
            [by_key(evaluate_boxes(truths, detected, half_table, CLASSES)) for half_table in frames]
        )
    for i in range(3):
        pair = [sides[f"{i}a"], sides[f"{i}b"]]
        same = [p for p in expected if _alike(pair, p) or _alike(pair, p[::-1])]
        assert len(same) == 1
        expected.remove(same[0])
    alone = evaluation(truths, detected, routes[:10], CLASSES).left_out
    assert "half" not in set(alone["unit"]), "one route has no halves"


def _alike(one, other):
    return all(a == pytest.approx(b, rel=1e-12) for a, b in zip(one, other, strict=True))


def test_without_an_individual_what_was_found_of_it_is_gone_too():
    random = np.random.default_rng(4)
    # Nothing overlaps but an object and its of_individual detections.
    truths, detected, routes = scene(random, 30, 3, 4000.0)
    frames = routes["frame"].tolist()
    left_out = evaluation(truths, detected, routes, CLASSES).left_out
    cars = truths[truths["class"] == "Car"]
    for key in cars["object_id"].unique()[:4]:
        near = np.zeros(len(detected), bool)
        for box in truths[truths["object_id"] == key].itertuples():
            apart = np.hypot(detected["x"] - box.x, detected["y"] - box.y)
            near |= (detected["frame"] == box.frame) & (apart < 2)
        rest = truths[truths["object_id"] != key]
        expected = by_key(evaluate_boxes(rest, detected[~near], frames, ["Car"]))
        of_individual = left_out[
            (left_out["left_out"] == f"s {key}") & (left_out["class"] == "Car")
        ]
        values = by_key(of_individual)
        assert without_ap(values) == pytest.approx({at: expected[at] for at in without_ap(values)})
        assert_areas(values, rest, detected[~near])
    # An individual is in 6 of 30 frames, so false alarms are left out from up to 5 stretches.
    alarms = left_out[left_out["left_out"].str.startswith("false alarms")]
    alarms = alarms[alarms["class"] == "Car"]
    assert (alarms["ground_truths"] == 0).all()
    apart = detected[["x", "y"]].to_numpy()[:, None] - truths[["x", "y"]].to_numpy()
    same = detected["frame"].to_numpy()[:, None] == truths["frame"].to_numpy()
    alone = ~(same & (np.hypot(*np.moveaxis(apart, -1, 0)) < 2)).any(axis=1)
    stretches = alarms["left_out"].nunique()
    assert 3 <= stretches <= 5
    for number in range(stretches):
        gone = alone & (detected["frame"] * stretches // 30 == number)
        values = by_key(alarms[alarms["left_out"] == f"false alarms {number}"])
        assert_areas(values, truths, detected[~gone])


def test_the_last_objects_leave_nothing():
    random = np.random.default_rng(6)
    truths, detected, routes = scene(random, 12, 2, 40.0, individuals=1)
    truths["object_id"] = "only"
    left_out = evaluation(truths, detected, routes, ["Car"]).left_out
    only = left_out[left_out["left_out"] == "s only"]
    assert len(only) == 13
    assert only["value"].isna().all()
    none = evaluation(truths[:0], detected, routes, ["Car"]).left_out
    assert none.empty
    assert "value" in none.columns
    assert evaluation(truths, detected, range(12), ["Car"]).left_out is None


def test_many_units_are_thrown_together():
    random = np.random.default_rng(7)
    truths, detected, routes = scene(random, 3 * MOST_UNITS, 2 * MOST_UNITS, 40.0)
    left_out = evaluation(truths, detected, routes, ["Car"]).left_out
    of_cars = left_out[(left_out["metric"] == "recall") & (left_out["class"] == "Car")]
    of_cars = of_cars[of_cars["unit"] == "individual"]
    of_cars = of_cars[(of_cars["iou"] == 0.5) & (of_cars["ground_truths"] > 0)]
    cars = truths.loc[truths["class"] == "Car", "object_id"].value_counts()
    assert (len(of_cars), of_cars["ground_truths"].sum()) == (MOST_UNITS, cars.sum())
    squares = (of_cars["ground_truths"] ** 2 / of_cars["members"]).sum()
    assert squares == pytest.approx((cars**2).sum())
