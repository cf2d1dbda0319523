"""The rigs of a sweep, opened in the studio."""

import pytest

from lidarplace.studio.rigs_file import read_rigs
from sweeps.configuration.grid import read_sweep
from sweeps.results.rigs import FILE, rigs_yaml
from tests.sweeps.small_log import write_sweep

OWN = {"convention": "carla", "mounts": [{"x": 0.1, "z": 2.0, "yaw_deg": 12.5, "lidar": "at128"}]}


@pytest.mark.parametrize(
    ("lidar", "expected"),
    [
        ("vlp16", "vlp16"),
        ({"name": "vlp16", "range": 80, "cloud_share": 0.5}, {"name": "vlp16", "range": 80.0}),
        ({"beams": 8, "cloud_share": 0.5}, {"beams": 8}),
        ({"profile": "released-code"}, {"azimuth_steps": 250}),
    ],
)
def test_the_rigs_of_a_sweep_are_the_same_in_the_studio(tmp_path, lidar, expected):
    item = {"placements": {"mine": OWN, "unused": {"mounts": [{"z": 1}]}}, "detector": None}
    item["grid"] = {"placement": ["mine", "line_roll"]}
    sweep = read_sweep(write_sweep(tmp_path, lidar=lidar, **item))
    (tmp_path / FILE).write_text(rigs_yaml(sweep))
    file = read_rigs(tmp_path / FILE)
    assert file.content["lidar"] == expected
    assert file.content["placements"]["mine"] == OWN
    opened = {rig.name: rig.placement(file.lidar) for rig in file.rigs}
    assert opened == {item.point.placement: item.rig for item in sweep.points}
