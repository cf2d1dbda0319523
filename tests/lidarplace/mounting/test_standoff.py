"""Height above the vehicle up to which a zone may reach."""

import pytest

from lidarplace.configuration.mounting import PlaceSettings, mountable
from lidarplace.mounting.vehicle import Vehicle, top_near

CAR = Vehicle.car()


def zone(**keys):
    place = {"x": [-0.5, 0.5], "y": [-0.6, 0.6]} | keys
    (zone,) = mountable({"roof": PlaceSettings.model_validate(place)}, CAR)
    return zone


@pytest.mark.parametrize(
    ("keys", "heights"),
    [
        ({"z": [1.6, 3.0]}, (1.6, 1.8)),
        ({"z": [1.6, 1.7]}, (1.6, 1.7)),
        ({"z": 1.8}, (1.8, 1.8)),
        ({"z": [0.5, 3.0], "standoff": 0}, (0.5, 1.5)),
        ({"z": [2.2, 3.0], "standoff": 1.0}, (2.2, 2.5)),
        ({"z": [2.2, 3.0], "standoff": 1.5}, (2.2, 3.0)),
        ({"z": [2.2, 3.0], "standoff": None}, (2.2, 3.0)),
        ({"z": [0.4, 2.0], "x": [1.5, 2.0]}, (0.4, 1.25)),  # above the bonnet
        ({"z": [0.4, 2.0], "x": [2.36, 2.45]}, (0.4, 1.25)),  # before it
        ({"z": [1.6, 3.0], "x": [0.5, 1.5]}, (1.6, 1.8)),  # above roof and bonnet
    ],
)
def test_higher_parts_are_cut_off(keys, heights):
    assert zone(**keys).z == pytest.approx(heights)


def test_without_a_body_nothing_is_above_it():
    (zone,) = mountable(
        {"mast": PlaceSettings(x=(0, 0), y=(0, 0), z=(5.0, 9.0))}, Vehicle("none", [])
    )
    assert zone.z == (5, 9)
    assert top_near(Vehicle("none", []), (0, 0), (0, 0)) is None
