"""Searches and the studio apply the same limits of mounting, with the same excess."""

from itertools import product

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.studio.rig import Rig
from lidarplace.studio.rigs_file import read_rigs
from lidarplace.studio.violations import violations
from sweeps.search.problem.constraints import measures_of
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar
from tests.sweeps.search_files import SEARCH, write_search

COMMON = {
    "vehicle": {
        "boxes": [[[0, -1.2, 0], [3, 1.2, 1.2]]],
        "trailer": {"hitch": [-1, 0], "boxes": [[[-3, -1, 0], [-1.5, 1, 2]]], "angles_deg": [50]},
        "keep_out": [[[1.0, 0.9, 1.0], [1.6, 1.3, 1.5]]],
    },
    "keep_out": {"rack": {"x": [-0.3, 0.3], "y": [-0.5, 0.5], "z": [1.2, 1.6]}},
    "constraints": {
        "distance": 0.6,
        "body_share": 0.1,
        "facing": 0,
        "common_view": {"share": 0.6, "pairs": "all"},
    },
}
AT = {"x": (-2.0, 0.0, 0.2, 1.2, 1.4, 3.5), "y": (-0.9, 0.0, 1.0), "z": (0.8, 1.4, 2.5)}
PLACES = [dict(zip(AT, at, strict=True)) for at in product(*AT.values())]
TURNS = [{"roll_deg": roll, "pitch_deg": pitch} for roll in (0.0, -20.0) for pitch in (0.0, 20.0)]


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    folder = tmp_path_factory.mktemp("limits")
    zones = {"any": {"x": [-4, 4], "y": [-2, 2], "z": [0.5, 3], "standoff": None}}
    problem = read_problem(write_search(folder, search=COMMON | {"zones": zones}))
    (folder / "studio.yaml").write_text(yaml.safe_dump(COMMON | {"lidar": SEARCH["lidar"]}))
    return problem.criteria, read_rigs(folder / "studio.yaml")


@given(
    places=st.lists(st.sampled_from(PLACES), min_size=2, max_size=3, unique_by=str),
    turns=st.tuples(*[st.sampled_from(TURNS)] * 3),
)
@settings(max_examples=20, derandomize=True)
def test_search_and_studio_agree(both, places, turns):
    check(both, [place | turn for place, turn in zip(places, turns, strict=False)])


@pytest.mark.parametrize("turn", [TURNS[0], TURNS[-1]])
def test_they_agree_on_every_place(both, turn):
    for place in PLACES:
        check(both, [place | turn])


def check(both, mounts):
    criteria, file = both
    rig = Rig.of_written("mine", {"mounts": mounts})
    in_studio = {}
    for violation in violations(rig, file):
        excess = in_studio.get(violation.limit, 0.0)
        in_studio[violation.limit] = max(excess, violation.excess)
    limits = [limit for limit in criteria.constraints if limit.name != "blind_lidars"]
    choices = tuple(MountedLidar("lidar", "any", mount) for mount in rig.mounts)
    measures = measures_of(choices, limits, criteria.carrier)
    in_search = {limit.name: limit.violation(measures[limit.name]) for limit in limits}
    assert {name: excess for name, excess in in_search.items() if excess > 0} == in_studio
