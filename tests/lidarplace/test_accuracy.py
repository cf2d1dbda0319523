"""Error against run time: what is varied, and what values mean at another resolution."""

import numpy as np
import pandas as pd
import pytest

from lidarplace import Lidar, Mount, OccupancyGrid, Placement, Roi, evaluate
from lidarplace.logs.box_log import BoxLog
from lidarplace.pog.surrogates.error_against_time import Variation, accuracy, scale

ROI = Roi((0, 8), (-4, 4), (0, 2), 0.4)
LIDAR = Lidar(tuple(np.radians(np.linspace(-25, 5, 8))), azimuth_steps=720)
PLACEMENT = Placement("one", [Mount(z=1.8)], LIDAR)
FRAMES = pd.DataFrame({"frame": range(8)})


def boxes():
    rng = np.random.default_rng(0)
    rows = [
        (frame, "Car", rng.uniform(1, 7), rng.uniform(-3, 3), 0.8, 3.0, 1.6, 1.5, rng.uniform(0, 3))
        for frame in range(8)
    ]
    columns = ["frame", "class", "x", "y", "z", "length", "width", "height", "yaw"]
    return pd.DataFrame(rows, columns=columns)


@pytest.fixture(scope="module")
def table():
    varied = {"resolutions": (0.2,), "azimuth_steps": (90, 1440), "frame_shares": (0.5,)}
    return accuracy(BoxLog(boxes(), FRAMES), ROI, "Car", PLACEMENT, Variation(**varied))


def test_each_way_is_there_once(table):
    way = ["surrogate", "method", "resolution", "azimuth_steps", "frames"]
    assert not table.duplicated(way).any()
    s_mig = table[table["surrogate"] == "s_mig"]
    assert set(s_mig[way[1:]].itertuples(index=False, name=None)) == {
        ("cone", 0.4, 0, 8),
        *((method, 0.4, n, 8) for method in ("dda", "bresenham") for n in (90, 1440)),
        ("cone", 0.2, 0, 8),
        ("cone", 0.4, 0, 4),
    }
    gain = table[table["surrogate"] == "expected_ig"]
    assert set(gain[way[1:]].itertuples(index=False, name=None)) == {
        *((method, 0.4, n, 8) for method in ("dda", "bresenham") for n in (90, 720)),
        ("dda", 0.2, 720, 8),
        ("dda", 0.4, 720, 4),
    }
    assert (table["seconds"] > 0).all()
    assert table.groupby(["resolution", "frames"])["pog_seconds"].nunique().eq(1).all()


def test_the_reference_is_the_finest_of_all(table):
    best = table[table["reference"]].set_index("surrogate")
    assert best.index.is_unique
    assert len(best) == 8
    assert set(best["resolution"]) == {0.2}
    fine = OccupancyGrid.from_boxes(boxes(), Roi(ROI.x, ROI.y, ROI.z, 0.2), "Car", 8)
    result = evaluate(fine, PLACEMENT, surrogates=("expected_points", "expected_ig"))
    for name, value in best["value"].items():
        assert value == pytest.approx(getattr(result, name), rel=1e-12)
    assert best.loc["ig", "comparable"] == pytest.approx(result.ig * 0.2**3)


def test_every_nth_frame_from_the_first(table):
    log = boxes()
    half = OccupancyGrid.from_boxes(log[log["frame"] % 2 == 0], ROI, "Car", 4)
    found = table[(table["frames"] == 4) & (table["surrogate"] == "h_pog")]["value"].item()
    assert found == pytest.approx(half.h_pog, rel=1e-12)


def test_values_that_are_scaled_mean_the_same_at_every_resolution():
    # Half-occupied space, seen by rays along x: the volume and the metres do not change.
    for resolution in (0.5, 0.25):
        shape = [round(4 / resolution)] * 3
        voxels = np.prod(shape)
        assert voxels * np.log(2) * scale("ig", resolution) == pytest.approx(64 * np.log(2))
        assert shape[0] * 0.5 * scale("expected_points", resolution) == pytest.approx(2.0)
        layer = shape[0] * shape[1]  # what a level beam covers
        assert layer * np.log(2) * scale("s_mig", resolution) == pytest.approx(16 * np.log(2))
    assert scale("m_sog", 0.1) == 1
