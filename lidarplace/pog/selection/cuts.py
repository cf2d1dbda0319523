"""Cuts, linear functions of the chosen candidates that no set exceeds, and the bound they give.

By weak duality any multipliers give a bound, so it is taken from the solver's dual multipliers,
made feasible, and holds whatever the solver's tolerances are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from lidarplace.pog.selection.limits import Limits


@dataclass(frozen=True, eq=False)
class Cut:
    """`constant[b] + slopes[b] @ x` is at least the value of block b at any set x."""

    constant: NDArray[np.float64]
    slopes: NDArray[np.float64]


def highest(cuts: Sequence[Cut], limits: Limits) -> tuple[float, NDArray[np.float64]]:
    """Return a bound of the sum over blocks of the least cut of each, and where it was found."""
    rows, capacity = limits.polytope
    blocks, candidates = cuts[0].slopes.shape
    constant = np.concatenate([cut.constant for cut in cuts])
    slopes = np.concatenate([cut.slopes for cut in cuts])
    unit = max(constant.max(), slopes.max(initial=0.0)) or 1.0
    value_of_block = np.tile(np.eye(blocks), (len(cuts), 1))
    cost = np.concatenate([np.zeros(candidates), -np.ones(blocks)])
    matrix = np.block([[-slopes / unit, value_of_block], [rows, np.zeros((len(rows), blocks))]])
    most = np.concatenate([constant / unit, capacity])
    bounds = [(0, 1)] * candidates + [(None, None)] * blocks
    solution = linprog(cost, matrix, most, bounds=bounds, method="highs")
    if solution.status != 0:
        raise RuntimeError(f"HiGHS found no bound: {solution.message}")
    duals = np.maximum(-solution.ineqlin.marginals, 0.0)
    of_cut = duals[: len(constant)].reshape(len(cuts), blocks)
    of_row = duals[len(constant) :] * unit
    # Multipliers of a block's cuts add up to 1: then the cuts hold for their mean.
    of_cut[0, of_cut.sum(axis=0) == 0] = 1.0
    of_cut = (of_cut / of_cut.sum(axis=0)).reshape(-1)
    left = of_cut @ slopes - of_row @ rows
    bound = of_cut @ constant + of_row @ capacity + np.maximum(left, 0.0).sum()
    return float(bound), np.clip(solution.x[:candidates], 0.0, 1.0)
