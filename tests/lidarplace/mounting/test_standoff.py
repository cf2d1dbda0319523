"""How far above the vehicle a zone may reach."""

import pytest
from pydantic import ValidationError

from lidarplace.configuration.mounting import PlaceSettings, mountable
from lidarplace.mounting.vehicle import Vehicle, top_near

CAR = Vehicle.car()


def zone(**keys):
    own = {"x": [-0.5, 0.5], "y": [-0.6, 0.6]} | keys
    (found,) = mountable({"roof": PlaceSettings.model_validate(own)}, CAR)
    return found


@pytest.mark.parametrize(
    ("keys", "heights"),
    [
        ({"z": [1.6, 3.0]}, (1.6, 1.8)),
        ({"z": [1.6, 1.7]}, (1.6, 1.7)),
        ({"z": 1.8}, (1.8, 1.8)),
        ({"z": [0.5, 3.0], "standoff": 0}, (0.5, 1.5)),
        ({"z": [2.2, 3.0], "standoff": 1.0}, (2.2, 2.5)),
        ({"z": [2.2, 3.0], "standoff": None}, (2.2, 3.0)),
        ({"z": [0.4, 2.0], "x": [1.5, 2.0]}, (0.4, 1.25)),  # above the bonnet
        ({"z": [0.4, 2.0], "x": [2.36, 2.45]}, (0.4, 1.25)),  # before it
        ({"z": [1.6, 3.0], "x": [0.5, 1.5]}, (1.6, 1.8)),  # above roof and bonnet
    ],
)
def test_higher_parts_are_cut_off(keys, heights):
    assert zone(**keys).z == pytest.approx(heights)


def test_a_zone_that_is_too_high_says_what_to_write():
    line = (
        r"zones.roof: z from 2.2 m is more than the standoff, 0.3 m, above the vehicle's body, "
        r"1.5 m there; write z up to 1.8, or with a rack standoff: 1.5$"
    )
    with pytest.raises(ValueError, match=line):
        zone(z=[2.2, 3.0])
    assert zone(z=[2.2, 3.0], standoff=1.5).z == (2.2, 3.0)


@pytest.mark.parametrize("bad", [-0.1, "high", float("nan"), True])
def test_bad_values(bad):
    with pytest.raises(ValidationError, match="standoff"):
        zone(z=1.6, standoff=bad)


def test_without_a_body_nothing_is_above_it():
    (found,) = mountable(
        {"mast": PlaceSettings(x=(0, 0), y=(0, 0), z=(5.0, 9.0))}, Vehicle("none", [])
    )
    assert found.z == (5, 9)
    assert top_near(Vehicle("none", []), (0, 0), (0, 0)) is None
