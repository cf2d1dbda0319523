"""Plain rigs that a search of an own vehicle is compared with."""

from types import SimpleNamespace

import numpy as np

from lidarplace import Mount
from sweeps.search.greedy.certificate import slots_of
from sweeps.search.problem.plain_rigs import plain_rigs
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar, ordered
from sweeps.search.verification.winners import baseline_of
from tests.sweeps.search_files import write_search

ZONES = {"roof": {"x": [0, 1], "y": [-0.6, 0.6], "z": [1.8, 2.4]}}
MODELS = {"wide": {"beams": 8, "price": 4}, "flash": {"beams": 12, "price": 2}}


def test_they_have_the_lidars_of_the_rig_at_plain_places(tmp_path):
    keys = {"lidars": 3, "zones": ZONES, "models": MODELS, "yaw_deg": [-30, 90], "roll_deg": [2, 9]}
    problem = read_problem(write_search(tmp_path, search=keys))
    turned = [Mount(0.1 * i, 0.2, 2.0, np.radians(5)) for i in range(3)]
    rig = ordered(
        MountedLidar(m, "roof", mount)
        for m, mount in zip(("wide", "wide", "flash"), turned, strict=True)
    )
    rigs = plain_rigs(problem.space, slots_of(rig, problem))
    assert [*rigs] == ["stack", "corners", "edges"]
    for plain in rigs.values():
        assert sorted(c.model for c in plain) == ["flash", "wide", "wide"]
        np.testing.assert_allclose([c.mount.yaw for c in plain], np.radians(30), atol=1e-4)
        np.testing.assert_allclose([c.mount.roll for c in plain], np.radians(2), atol=1e-4)
    stack = {(c.mount.x, c.mount.y, c.mount.z) for c in rigs["stack"]}
    assert stack == {(0.5, 0.0, 2.4), (0.5, 0.0, 2.1), (0.5, 0.0, 1.8)}
    corners = {(c.mount.x, c.mount.y, c.mount.z) for c in rigs["corners"]}
    assert corners == {(1.0, 0.6, 2.4), (1.0, -0.6, 2.4), (0.0, 0.6, 2.4)}
    middles = {(0.5, 0.6), (0.5, -0.6), (0.0, 0.0), (1.0, 0.0)}
    assert {(c.mount.x, c.mount.y) for c in rigs["edges"]} < middles


def test_a_flat_zone_has_no_stack(tmp_path):
    keys = {"lidars": 2, "zones": {"roof": ZONES["roof"] | {"z": 2.0}}, "models": MODELS}
    problem = read_problem(write_search(tmp_path, search=keys))
    rig = ordered(MountedLidar("wide", "roof", Mount(x, 0.0, 2.0)) for x in (0.2, 0.8))
    assert [*plain_rigs(problem.space, slots_of(rig, problem))] == ["corners", "edges"]


def test_the_baseline_keeps_the_constraints_if_a_plain_rig_does():
    def rig(role, feasible):
        return SimpleNamespace(role=role, assessment=SimpleNamespace(feasible=feasible))

    rigs = {"found_1": rig("found", True), "stack": rig("plain", False)}
    assert baseline_of(rigs) == "stack"
    assert baseline_of(rigs | {"corners": rig("plain", True)}) == "corners"
    assert baseline_of({"line": rig("paper", False), "center": rig("paper", True)}) == "line"
