"""A trailer that turns, against boxes that are where it is then."""

from contextlib import nullcontext

import numpy as np
import pytest
import yaml

from lidarplace import Lidar, Mount, Placement
from lidarplace.clouds.own_body import check_mounts
from lidarplace.configuration.vehicle import read_vehicle
from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.housing import NO_HOUSINGS
from lidarplace.mounting.sight import obstacles_of, stopped
from lidarplace.mounting.trailer import BendingVehicle
from lidarplace.mounting.vehicle import Vehicle, depth_in_body
from lidarplace.requirements.area import Area
from lidarplace.requirements.check_requirements import check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.requirement import STANDARD, AlsoWhen, Requirement
from tests.refused import refused

CAB = [[-1.0, -1.2, 0.0], [2.5, 1.2, 3.0]]
BOX = [[-9.0, -1.25, 1.0], [-1.5, 1.25, 4.0]]
HITCH = (-1.5, 0.0)
# Where the box is when it has turned by a right angle about the hitch.
RIGHT = [[-2.75, -7.5, 1.0], [-0.25, 0.0, 4.0]]
LEFT = [[-2.75, 0.0, 1.0], [-0.25, 7.5, 4.0]]
RIG = Placement(
    "mirrors",
    [Mount(2.0, 1.4, 2.2, pitch=0.3), Mount(2.0, -1.4, 2.2, pitch=0.3), Mount(2.6, 0, 1.0)],
    lidar=Lidar.even(16, (-25, 15), azimuth_steps=720),
)


def bending(*angles):
    return BendingVehicle("truck", np.array([BOX, CAB]), None, 1, HITCH, angles)


def boxed(box):
    return Vehicle("truck", np.array([box, CAB]))


def asked(measure, least, **further):
    object_ = None if measure == "coverage" else STANDARD["Pedestrian"]
    area = Area(x=(-6.0, 4.0), y=((-6.0, -2.0), (2.0, 6.0)))  # free when it is straight
    return Requirement("near", area, measure, least, object_, step=0.5, **further)


@pytest.mark.parametrize(
    "wanted",
    [
        asked("points", 5.0, share=0.7, also_when=AlsoWhen(one_lidar_dead=True)),
        asked("cells", 3.0, share=0.9),
        asked("coverage", 0.4),
    ],
    ids=lambda own: own.measure,
)
def test_at_right_angles_it_is_a_box(wanted):
    vehicle = bending(90.0, -90.0)
    (outcome,) = check_requirements([lay_out(wanted, vehicle)], RIG, vehicle)
    by_case = {finding.case: finding for finding in outcome.cases}
    for label, box in (("", BOX), ("trailer at 90°", RIGHT), ("trailer at −90°", LEFT)):
        plain = boxed(box)
        (expected,) = check_requirements([lay_out(wanted, plain)], RIG, plain)
        for finding in expected.cases:
            plainly = "" if finding.case == "as built" else finding.case
            case = by_case.pop(", ".join(filter(None, [label, plainly])) or "as built")
            assert (case.value, case.enough) == pytest.approx((finding.value, finding.enough))
            assert (case.x, case.y) == pytest.approx((finding.x, finding.y))
    assert not by_case
    assert outcome.worst.value == min(finding.value for finding in outcome.cases)
    assert outcome.worst.value < outcome.cases[0].value, "it hides something when it turns"


@pytest.mark.parametrize("degrees", [-60.0, -7.0, 33.0, 120.0])
def test_rays_meet_the_turned_box_as_turned_rays_meet_the_box(degrees):
    random = np.random.default_rng(3)
    pose = bending(degrees).poses[f"trailer at {degrees:g}°".replace("-", "−")]
    alone = Vehicle("trailer", np.array([BOX]))
    turned, straight = obstacles_of(pose, NO_HOUSINGS), obstacles_of(alone, NO_HOUSINGS)
    cab = obstacles_of(Vehicle("cab", np.array([CAB])), NO_HOUSINGS)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    back = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    hitch = np.array([*HITCH, 0.0])
    met = 0
    for _ in range(1500):
        origin, ray = random.uniform([-12, -12, 0], [5, 12, 5]), random.normal(size=3)
        at = back @ (origin - hitch) + hitch
        if depth_in_body(alone, at[None])[0] > 0 or depth_in_body(boxed(BOX), origin[None])[0] > 0:
            continue
        expected = stopped(at, *(back @ ray), 30.0, straight, -1)
        expected |= stopped(origin, *ray, 30.0, cab, -1)
        assert stopped(origin, *ray, 30.0, turned, -1) == expected
        met += expected
    assert met > 40


def test_the_worst_of_all_angles_counts():
    vehicle, parts = bending(90.0, -90.0), [boxed(box) for box in (BOX, LEFT, RIGHT)]
    for mount, lidar in zip(RIG.mounts, RIG.lidars, strict=True):
        most = max(body_share(mount, lidar, part) for part in parts)
        assert body_share(mount, lidar, vehicle) == pytest.approx(most)


def test_no_lidar_is_where_the_trailer_may_be():
    places = np.array([[-5.0, 0, 4.5], [-1.5, 3.0, 2.0], [-1.5, -3.0, 2.0], [-1.5, 3.0, 4.5]])
    on, left, right, above_turned = depth_in_body(bending(90.0, -90.0), places)
    assert on > 0, "above the straight trailer: it would turn with it"
    assert left > 0
    assert right > 0
    assert above_turned == 0
    rig = Placement("roof", [Mount(-5.0, 0.0, 4.2)], lidar=Lidar.paper())
    with pytest.raises(ValueError, match="on or in the way of its trailer; expected a place on"):
        check_mounts(rig, bending(60.0))
    check_mounts(rig, boxed(BOX))


def test_a_file_says_it(tmp_path):
    path = tmp_path / "truck.yaml"
    path.write_text(
        f"{{boxes: [{CAB}], trailer: {{hitch: [-1.5, 0], boxes: [{BOX}], angles_deg: [-60, 0]}}}}"
    )
    vehicle = read_vehicle(path)
    assert isinstance(vehicle, BendingVehicle)
    assert list(vehicle.poses) == ["", "trailer at −60°"]
    np.testing.assert_array_equal(vehicle.boxes, [BOX, CAB])


UNDER = [[-9.0, -1.0, -2.0], [-2.0, 1.0, 0.0]]


@pytest.mark.parametrize(
    ("boxes", "angles", "body", "mistake"),
    [
        ([], [9], [], ("truck.yaml", "trailer.boxes", "")),
        ([UNDER, UNDER], [9], [], ("truck.yaml", "trailer.boxes", "0.0")),
        ([BOX, UNDER], [1.04, -1.04, 0], [], ("truck.yaml", "trailer.angles_deg", "1.04")),
        ([BOX], [9], [UNDER], ("truck.yaml", "boxes", "0.0")),
        ([BOX, UNDER], [1.04, -20], [], None),
        ([BOX], [0], [CAB, UNDER], None),
    ],
)
def test_implausible_trailers(tmp_path, boxes, angles, body, mistake):
    path, trailer = tmp_path / "truck.yaml", {"hitch": [0, 0], "boxes": boxes, "angles_deg": angles}
    path.write_text(yaml.safe_dump({"boxes": body, "trailer": trailer}))
    with refused(mistake) if mistake else nullcontext():
        read_vehicle(path)
