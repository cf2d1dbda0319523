"""Areas that follow UN Regulations: our reading of them, to compare with their text.

The regulations ask for signals to a driver in tests with a moving vehicle; here only the ground is
taken from them on which somebody stands. Right-hand traffic.

- UN R151, blind spot information (https://unece.org/sites/default/files/2021-08/R151e.pdf).
- UN R158, reversing: objects 0.8 m high and 0.3 m wide are detected from 0.2 to 1 m behind the
  vehicle, or seen from 0.3 to 3.5 m.
- UN R159, moving off. Of this and R158: UNECE, *Two new UN Vehicle Regulations will increase the
  protection of pedestrians and cyclists*
  (https://unece.org/sustainable-development/press/two-new-un-vehicle-regulations-will-increase-protection-pedestrians).
"""

from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Area

PRESETS = ("un_r151", "un_r158", "un_r159")


def preset(name: str, vehicle: Vehicle) -> Area:
    """The area of a preset around this vehicle.

    - `un_r151`: to the right of the whole vehicle, 0.9 to 4.25 m from its side.
    - `un_r158`: behind the vehicle, as wide as it, from 0.2 to 3.5 m.
    - `un_r159`: before the vehicle, as wide as it, from 0.8 to 3.7 m.

    Raises:
        ValueError: there is no preset of that name, or the vehicle has no body.
    """
    if name not in PRESETS:
        raise ValueError(f"where.preset: found {name!r}; allowed are {', '.join(PRESETS)}")
    if not len(vehicle.extents):
        raise ValueError(
            f"where.preset: {name} lies around the vehicle's body, and the vehicle has none"
        )
    rear, right, _ = vehicle.extents[:, 0].min(axis=0).tolist()
    front, left, _ = vehicle.extents[:, 1].max(axis=0).tolist()
    if name == "un_r151":
        return Area(x=(rear, front), y=((right - 4.25, right - 0.9),))
    if name == "un_r158":
        return Area(x=(rear - 3.5, rear - 0.2), y=((right, left),))
    return Area(x=(front + 0.8, front + 3.7), y=((right, left),))
