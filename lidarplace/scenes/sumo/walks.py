"""Endless random walks through a road network, on wheels and on foot."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane

CHANGE_M = 40.0  # edges shorter than this are no place to plan a change of lanes
START_M = 10.0
"""Shorter lanes are no place to start: a truck and the gap to the next vehicle need as much."""
TURNAROUND = "t"  # SUMO's direction of a connection that leads back


@dataclass(frozen=True)
class WalkGraph:
    """States that a walk passes through, each with a way on: one strongly connected component.

    A state of a vehicle is a lane; of a pedestrian, an edge and the direction he walks in."""

    keys: list[Any]  # a lane's id or (edge id, direction) of every state, sorted
    edges: list[str]  # of every state
    following: list[list[int]]  # the states that may come after each, sorted; never empty
    length: list[float]  # metres of each state
    seconds: list[float]  # least time in each state
    index: dict[Any, int]  # number of the state by its key

    def walk(self, seconds: float, rng: np.random.Generator, start: int) -> Iterator[str]:
        """Yield ids of connected edges from state `start` on.

        They take at least `seconds` after the first."""
        state = start
        yield self.edges[state]
        while seconds > 0:
            ways = self.following[state]
            state = ways[rng.integers(len(ways))]
            seconds -= self.seconds[state]
            yield self.edges[state]

    def anywhere(self, rng: np.random.Generator) -> int:
        """Draw a state to start from, the more room it has beyond `START_M` the likelier."""
        ends = np.cumsum(np.maximum(np.array(self.length) - START_M, 0.01))
        return int(np.searchsorted(ends, rng.uniform(0, ends[-1]), side="right"))


def drive_graph(network: Net, sumo_class: str) -> WalkGraph:
    """Build the graph of the lanes that vehicles of `sumo_class` may use.

    A vehicle may leave an edge of `CHANGE_M` or more from any of its lanes, a shorter one from the
    lane on which it came. Turning round is left to dead ends."""
    every = (lane for edge in _edges(network) for lane in edge.getLanes())
    lanes = [lane for lane in every if lane.allows(sumo_class)]
    onward = {lane.getID(): _onward(lane, sumo_class) for lane in lanes}
    states, ways = {}, {}
    for lane in lanes:
        edge = lane.getEdge()
        states[lane.getID()] = (edge.getID(), lane.getLength(), lane.getSpeed())
        exits = edge.getLanes() if edge.getLength() >= CHANGE_M else [lane]
        targets = {way for other in exits for way in onward.get(other.getID(), ())}
        ahead = {target for target, back in targets if not back}
        ways[lane.getID()] = ahead or {target for target, _ in targets}
    return _component(states, ways)


def foot_graph(network: Net, speed: float) -> WalkGraph:
    """Build the graph of sidewalks, both ways, as walking areas and crossings join them.

    Needs a network that was read with its pedestrian connections. `speed` is in m/s."""
    joined = _joined_areas(network)
    states: dict[Any, tuple[str, float, float]] = {}
    first: dict[Any, int] = {}
    last: dict[Any, int] = {}
    starts = defaultdict(set)
    for edge in _edges(network):
        sides = [
            [joined[other.getID()] for other in near if other.getID() in joined]
            for near in (edge.getIncoming(), edge.getOutgoing())
        ]
        if edge.allows("pedestrian") and all(sides):
            begin, end = (areas[-1] for areas in sides)
            for way, start, stop in ((1, begin, end), (-1, end, begin)):
                state = (edge.getID(), way)
                states[state] = (edge.getID(), edge.getLength(), speed)
                first[state], last[state] = start, stop
                starts[start].add(state)
    ways = {}
    for state in states:
        on = {other for other in starts[last[state]] if other[0] != state[0]}
        ways[state] = {other for other in on if last[other] != first[state]} or on
    return _component(states, ways)


def _edges(network: Net) -> list[Edge]:
    return sorted(network.getEdges(withInternal=False), key=lambda edge: edge.getID())


def _onward(lane: Lane, sumo_class: str) -> set[tuple[str, bool]]:
    """Return lanes that connections lead to from `lane`, and whether by turning round."""
    return {
        (way.getToLane().getID(), way.getDirection() == TURNAROUND)
        for way in lane.getOutgoing()
        if way.getToLane().allows(sumo_class) and way.getToLane().getEdge().getFunction() == ""
    }


def _joined_areas(network: Net) -> dict[str, int]:
    """Number walking areas and crossings by id, equally where crossings of a junction join them."""
    edges = network.getEdges()
    areas = sorted(e.getID() for e in edges if e.getFunction() in ("walkingarea", "crossing"))
    index = {name: a for a, name in enumerate(areas)}
    arcs = [
        (a, index[other.getID()])
        for name, a in index.items()
        for other in network.getEdge(name).getOutgoing()
        if other.getID() in index
    ]
    labels = _components(len(areas), arcs, "weak")
    return {name: int(labels[a]) for name, a in index.items()}


def _component(states: dict[Any, tuple[str, float, float]], ways: dict[Any, set[Any]]) -> WalkGraph:
    """Return the longest strongly connected component; states are (edge, length, speed) by key.

    A single state counts only if it leads to itself, so the component may be empty."""
    keys = sorted(states)
    index = {key: k for k, key in enumerate(keys)}
    arcs = [(index[key], index[way]) for key in keys for way in sorted(ways[key]) if way in index]
    labels = _components(len(keys), arcs, "strong")
    length = np.array([states[key][1] for key in keys], np.float64)
    leads_on = np.zeros(len(keys), bool)
    leads_on[[a for a, b in arcs if labels[a] == labels[b]]] = True
    totals = np.bincount(labels, weights=length * leads_on) if len(keys) else np.zeros(1)
    members = np.flatnonzero((labels == totals.argmax()) & leads_on)
    new = {int(old): k for k, old in enumerate(members)}
    following: list[list[int]] = [[] for _ in members]
    for a, b in arcs:
        if a in new and b in new:
            following[new[a]].append(new[b])
    chosen = [states[keys[k]] for k in members]
    keys = [keys[k] for k in members]
    edges, metres = [edge for edge, _, _ in chosen], [length for _, length, _ in chosen]
    seconds = [length / speed for _, length, speed in chosen]
    return WalkGraph(
        keys, edges, following, metres, seconds, {key: n for n, key in enumerate(keys)}
    )


def _components(nodes: int, arcs: list[tuple[int, int]], connection: str) -> NDArray[np.int32]:
    start, end = np.array(arcs, np.int64).reshape(-1, 2).T
    matrix = coo_array((np.ones(len(arcs), np.int8), (start, end)), shape=(nodes, nodes))
    return np.asarray(connected_components(matrix, connection=connection)[1])
