"""Walks never strand, use only connections that are there, and turn round at dead ends only."""

from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest

from lidarplace.scenes.sumo.maps import build_network
from lidarplace.scenes.sumo.walks import CHANGE_M, drive_graph, foot_graph

pytest.importorskip("sumolib")
from sumolib.net import Net, readNet

MAPS = Path(__file__).parents[1] / "data" / "maps"


def read(path: Path) -> Net:
    return readNet(str(path), withInternal=True, withPedestrianConnections=True)


@pytest.fixture(scope="module")
def generated(tmp_path_factory) -> Net:
    return read(build_network("generated", 5, tmp_path_factory.mktemp("town")).path)


@pytest.fixture(scope="module")
def street(tmp_path_factory) -> Net:
    return read(build_network(str(MAPS / "street.xodr"), 0, tmp_path_factory.mktemp("street")).path)


@pytest.mark.parametrize("sumo_class", ["passenger", "bicycle"])
def test_every_step_is_a_connection(generated, sumo_class):
    graph = drive_graph(generated, sumo_class)
    rng = np.random.default_rng(0)
    walk = list(graph.walk(2000, rng, graph.anywhere(rng)))
    assert len(walk) > 100
    for here, there in pairwise(walk):
        onward = generated.getEdge(here).getAllowedOutgoing(sumo_class)
        assert generated.getEdge(there) in onward
    assert len(set(walk)) > 0.9 * len(set(graph.edges))


def test_a_walk_lasts_as_long_as_asked(generated):
    graph, rng = drive_graph(generated, "passenger"), np.random.default_rng(1)
    walk = list(graph.walk(300, rng, graph.anywhere(rng)))
    edges = [generated.getEdge(name) for name in walk]
    least = sum(e.getLength() / max(lane.getSpeed() for lane in e.getLanes()) for e in edges[1:])
    assert 300 <= least < 330


def test_a_short_edge_is_left_from_the_lane_of_arrival(generated):
    graph = drive_graph(generated, "passenger")
    for lane_id, ways in zip(graph.keys, graph.following, strict=True):
        lane = generated.getLane(lane_id)
        if lane.getEdge().getLength() < CHANGE_M:
            own = {c.getToLane().getID() for c in lane.getOutgoing()}
            assert {graph.keys[way] for way in ways} <= own


def test_turning_round_at_dead_ends_only(street):
    graph = drive_graph(street, "passenger")
    walk = list(islice(graph.walk(1e9, np.random.default_rng(0), 0), 6))
    assert walk == ["-1", "1"] * 3


def test_no_way_into_what_has_no_way_out():
    graph = drive_graph(read(MAPS / "block.net.xml"), "passenger")
    assert graph.edges in (["-e", "-n", "-s", "-w"], ["e", "n", "s", "w"])
    assert "out" not in graph.edges


def test_pedestrians_walk_both_ways_and_cross(generated):
    graph = foot_graph(generated, 1.5)
    assert {way for _, way in graph.keys} == {1, -1}
    rng = np.random.default_rng(0)
    walk = list(graph.walk(3000, rng, graph.anywhere(rng)))
    for here, there in pairwise(walk):
        a, b = generated.getEdge(here), generated.getEdge(there)
        assert {a.getFromNode(), a.getToNode()} & {b.getFromNode(), b.getToNode()}
        assert here != there
    edges = {edge.getID() for edge in generated.getEdges(withInternal=False)}
    assert {name for name, _ in graph.keys} == edges
    # No sidewalks give an empty graph.
    assert foot_graph(read(MAPS / "block.net.xml"), 1.5).edges == []


def test_long_lanes_are_likelier_to_start_from(generated):
    graph = drive_graph(generated, "passenger")
    rng = np.random.default_rng(0)
    draws = np.bincount([graph.anywhere(rng) for _ in range(20_000)], minlength=len(graph.edges))
    room = np.array(graph.length) - 10
    np.testing.assert_allclose(draws / 20_000, room / room.sum(), atol=0.006)
