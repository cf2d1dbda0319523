"""The surrogate: against a mean by hand, its error, its options, its extremes."""

import numpy as np
import pytest

from lidarplace import ExpectedRecall, Lidar, Mount, Placement
from lidarplace.recall.baselines import baselines, per_object
from lidarplace.recall.surface_cells import slices_of
from tests.lidarplace.recall.small_scenes import (
    CURVES,
    LIDAR,
    MOUNTS,
    ROI,
    ROWS,
    cells_hit,
    decoded,
    log_of,
    model_of,
    table_of,
)
from tests.refused import refused

RIG = Placement("rig", MOUNTS, lidar=LIDAR)


def test_it_is_the_mean_probability_of_the_objects_of_a_class():
    model = model_of(*ROWS[:4])
    boxes = [[row[2], row[3], row[6] / 2, *row[4:]] for row in ROWS[:4]]
    cells, _ = cells_hit(boxes, MOUNTS, LIDAR, 0.3, ROI)
    found = model.of(RIG)
    for name, most, rate in (("Tram", 0.9, 0.05), ("Bus", 0.7, 0.2)):
        counts = [len(c) for c, row in zip(cells, ROWS, strict=False) if row[1] == name]
        mean = np.mean([most * (1 - np.exp(-rate * count)) for count in counts])
        assert found.loc[name, "expected_recall"] == pytest.approx(mean, rel=1e-12)
        assert found.loc[name, "objects"] == found.loc[name, "individuals"] == 2


def test_a_mount_is_one_whichever_rig_has_it():
    model = model_of()
    ones = [Placement(str(n), [mount], lidar=LIDAR) for n, mount in enumerate(MOUNTS)]
    pair = Placement("pair", MOUNTS[1:], lidar=LIDAR)
    *single, rig, pair = model.objects.seen_by([*ones, RIG, pair])
    joined = single[0].and_(single[1]).and_(single[2])
    assert joined.cells.tolist() == rig.cells.tolist()
    assert joined.points.tolist() == rig.points.tolist()
    assert single[1].and_(single[2]).cells.tolist() == pair.cells.tolist()
    assert model.recall(joined).equals(model.of(RIG))


def test_the_overlap_chooses_the_curve():
    loose, strict = (model_of(classes=["Tram"], iou=iou) for iou in (0.5, 0.7))
    assert strict.of(RIG).iloc[0, 0] < loose.of(RIG).iloc[0, 0]
    with refused(("", "", "Bus at 0.7")):
        model_of(classes=["Bus"], iou=0.7)


def test_frames_are_spread_evenly():
    rows = [(frame, *ROWS[0][1:]) for frame in range(11)]
    model = model_of(*rows, classes=["Tram"], frames=3)
    assert model.objects.table["frame"].tolist() == [0, 5, 10]
    one = model_of(*rows, classes=["Tram"], frames=1)
    assert one.objects.table["frame"].tolist() == [0]
    assert np.isnan(one.of(RIG).loc["Tram", "standard_error"])
    every = model_of(*rows, classes=["Tram"], frames=99)
    assert len(every.objects.table) == 11


def test_the_standard_error_counts_individuals():
    rows = [(n, "Tram", 10.0 + 2 * n, n - 2.0, 4.0, 1.8, 1.6, 0.3 * n) for n in range(6)]
    model = model_of(*rows, classes=["Tram"])
    seen = model.objects.seen_by([RIG])[0]
    p = model.probabilities(seen)
    found = model.recall(seen).loc["Tram"]
    assert found["standard_error"] == pytest.approx(p.std(ddof=1) / np.sqrt(6), rel=1e-12)
    twice = log_of(*rows, *((10 + row[0], *row[1:]) for row in rows))
    twice.boxes["object_id"] = [f"o{n % 6}" for n in range(12)]
    again = ExpectedRecall.from_log(twice, ROI, ["Tram"], CURVES).of(RIG).loc["Tram"]
    assert again["objects"] == 12
    assert again["individuals"] == 6
    assert again["standard_error"] == pytest.approx(found["standard_error"], rel=1e-12)


def test_no_objects():
    model = model_of(ROWS[0], classes=["Bus"])
    found = model.of(RIG)
    assert found.loc["Bus", "objects"] == 0
    assert np.isnan(found.loc["Bus", "expected_recall"])
    assert baselines(model.objects, model.objects.seen_by([RIG])[0]).empty


def test_fewer_azimuth_steps():
    whole, thin, one_step = (
        model_of(classes=["Tram"], azimuth_share=share) for share in (1.0, 0.5, 1e-6)
    )
    half = RIG.with_lidar(LIDAR.thinned(0.5))
    assert thin.of(RIG).equals(whole.of(half))
    assert thin.of(RIG).iloc[0, 0] < whole.of(RIG).iloc[0, 0]
    assert one_step.of(RIG).iloc[0, 0] >= 0
    narrow = Lidar(LIDAR.elevations, 720, azimuth=(0.3, 0.32))
    with pytest.raises(ValueError, match="none of the 1 azimuth steps"):
        one_step.of(Placement("narrow", [Mount(z=2.5)], lidar=narrow))


def test_baselines_are_means_over_objects():
    model = model_of()
    seen = model.objects.seen_by([Placement("one", MOUNTS[:1], lidar=LIDAR)])[0]
    table = per_object(model.objects, seen)
    sets = decoded(seen, slices_of(model.objects.geometry, 0.3))
    sizes = model.objects.table[["length", "width", "height"]].to_numpy()
    for n, cells in enumerate(sets):
        for axis, name in enumerate(("length", "width", "height")):
            hit = [cell[axis] for cell in cells]
            span = min(0.3 * (max(hit) - min(hit) + 1), sizes[n, axis])
            assert table[name].iloc[n] == pytest.approx(span)
    found = baselines(model.objects, seen).loc["Tram"]
    own = table[table["class"] == "Tram"]
    assert found["log_points"] == pytest.approx(np.mean([np.log(1 + n) for n in own["points"]]))
    assert found["log_cells"] == pytest.approx(np.mean([np.log(1 + n) for n in own["cells"]]))
    assert found["enough_points"] == np.mean([n >= 5 for n in own["points"]])
    tram = (model.objects.table["class"] == "Tram").to_numpy()
    assert found["height"] == pytest.approx((own["height"] / sizes[tram, 2]).mean())


def test_what_is_not_hit_has_no_extent():
    model = model_of(*ROWS[:2])
    nothing = per_object(model.objects, table_of([set(), set()]))
    assert (nothing[["points", "cells", "length", "width", "height"]] == 0).all().all()
