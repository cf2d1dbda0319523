from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement, Roi
from lidarplace.coverage import coverage
from lidarplace.coverage.rays import ray_counts
from lidarplace.rigs.pose import from_carla

TABLE = pd.read_csv(Path(__file__).parents[1] / "data/paper_placements.csv")


def test_paper_placements_are_the_papers_table():
    assert list(PAPER_PLACEMENTS) == list(TABLE["placement"].unique())
    for name, rows in TABLE.groupby("placement"):
        expected = {
            Mount(*from_carla(r.x_m, r.y_m, r.z_m, r.roll_rad, r.pitch_rad))
            for r in rows.itertuples()
        }
        assert set(PAPER_PLACEMENTS[name].mounts) == expected


def test_side_lidars_look_out_and_the_front_one_down():
    left = PAPER_PLACEMENTS["line_roll"].mounts[0]
    assert left.y > 0
    assert (left.rotation @ [0, 1, 0])[2] < 0, "the left LiDAR's left side is down"
    front = PAPER_PLACEMENTS["pyramid_pitch"].mounts[1]
    assert (front.rotation @ [1, 0, 0])[2] < 0


def test_paper_lidar():
    lidar = Lidar.paper()
    assert lidar.beams * lidar.azimuth_steps == 90_000
    np.testing.assert_allclose(np.degrees(lidar.elevations), np.linspace(-25, 5, 16))
    np.testing.assert_allclose(np.linalg.norm(lidar.directions(), axis=1), 1.0)


def test_every_mount_may_have_a_model_of_its_own():
    few, many = Lidar((0.0,), 10), Lidar((-0.1, 0.1), 20)
    mounts = [Mount(z=1), Mount(z=2)]
    mixed = Placement("mixed", mounts, lidar=[few, many])
    assert mixed.lidars == (few, many)
    assert mixed != Placement("mixed", mounts, lidar=[many, few])
    alike = Placement("mixed", mounts, lidar=[few, few])
    assert alike == Placement("mixed", mounts, lidar=few)
    assert alike.lidars == (few, few)
    assert mixed.with_lidar(few) == alike


def test_a_mixed_rig_covers_what_its_lidars_cover_alone():
    roi = Roi((0, 8), (-4, 4), (0, 2), 0.5)
    models = [Lidar((-0.3, 0.0), 90), Lidar((-0.2,), 200, range=5.0)]
    mounts = [Mount(z=1.5), Mount(x=1, y=0.5, z=1.8, roll=0.2)]
    alone = [Placement("one", [m], lidar=model) for m, model in zip(mounts, models, strict=True)]
    mixed = Placement("mixed", mounts, lidar=models)
    for method in ("cone", "dda"):
        parts = [coverage(rig, roi, method) for rig in alone]
        np.testing.assert_array_equal(coverage(mixed, roi, method), parts[0] | parts[1])
    counts = [ray_counts(rig, roi, "dda") for rig in alone]
    np.testing.assert_array_equal(ray_counts(mixed, roi, "dda"), counts[0] + counts[1])
