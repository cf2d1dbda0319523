import pytest

from lidarplace import Roi


def test_shape_and_centres():
    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
    assert roi.shape == (400, 400, 40)
    assert roi.centres(1)[0] == pytest.approx(-19.95)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": (40, 0)}, r"ROI x needs min < max, found \[40.0, 0.0\]"),
        ({"z": (0, float("inf"))}, "ROI z needs min < max"),
        (
            {"y": (-20, 20.03)},
            "nearest multiple is 40 m, the nearest resolution that fits is 0.100075 m",
        ),
        ({"resolution": 0.0}, "resolution must be a positive length"),
        ({"resolution": 50.0}, "no multiple of the resolution"),
    ],
)
def test_bad_roi(changes, message):
    good = {"x": (0, 40), "y": (-20, 20), "z": (0, 4), "resolution": 0.1}
    with pytest.raises(ValueError, match=message):
        Roi(**(good | changes))
