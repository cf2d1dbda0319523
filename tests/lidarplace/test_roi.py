import pytest

from lidarplace import Roi


def test_shape_and_centres():
    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
    assert roi.shape == (400, 400, 40)
    assert roi.centres(1)[0] == pytest.approx(-19.95)
