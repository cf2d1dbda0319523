"""The range of a network: the ROI's, its own heights in a sensor's frame, whole cells."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from training import NETWORKS, build_detector
from training.detectors.point_range import fitted_range

OWN = (0.0, -40.0, -3.0, 70.4, 40.0, 1.0)
ROI = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)


def test_heights_follow_the_roi_in_the_ego_frame_only():
    assert fitted_range(OWN, 1.73, None) == OWN
    assert fitted_range(OWN, 1.73, ROI) == (0, -20, -3, 40, 20, 1)
    assert fitted_range(OWN, 0.0, ROI) == ROI


lengths = st.floats(0.5, 200)


@given(lengths, lengths, lengths, st.floats(0.05, 3.2), st.floats(0.05, 0.5))
def test_ranges_grow_by_less_than_a_cell_to_whole_cells(x, y, z, edge, height):
    wanted = (1.0, -7.0, -1.0, 1.0 + x, -7.0 + y, -1.0 + z)
    found = fitted_range(OWN, 0.0, wanted, (edge, edge, height))
    assert found[:3] == wanted[:3]
    for axis, cell in enumerate((edge, edge, height)):
        cells = (found[3 + axis] - found[axis]) / cell
        assert cells == pytest.approx(round(cells), abs=1e-6)
        assert -1e-5 * cell < found[3 + axis] - wanted[3 + axis] < cell


def test_rounding_adds_no_cell():
    assert fitted_range(OWN, 0.0, (0.0, 0.0, 0.0, 0.3, 0.7, 1.0), (0.1, 0.1))[3:] == pytest.approx(
        (0.3, 0.7, 1.0)
    )


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("preset", ["openpcdet", "paper"])
def test_weights_fit_whatever_the_roi(network, preset):
    own = build_detector(network, ["Car"], preset=preset)
    other = build_detector(network, ["Car"], preset=preset, point_range=(5, -9, -2, 33, 9, 7.3))
    assert other.point_range[:2] == (5, -9)
    assert (other.point_range[2], other.point_range[5]) == (-3, 1)
    shapes = {key: value.shape for key, value in own.state_dict().items()}
    assert {key: value.shape for key, value in other.state_dict().items()} == shapes
