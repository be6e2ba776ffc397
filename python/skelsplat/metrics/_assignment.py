"""The assignment problem, for small matrices."""

from __future__ import annotations

import numpy as np

from skelsplat._arrays import Array, Index


def cheapest_pairs(cost: Array) -> Index:
    """Pair rows with columns: as many pairs of finite cost as there can be, of the least total cost.

    Parameters
    ----------
    cost : (R, C)
        Of any sign; infinite = may not be paired.

    Returns
    -------
    (K, 2) int64
        Rows and columns, in the order of the rows.
    """
    allowed = np.isfinite(cost)
    if not allowed.any():
        return np.empty((0, 2), dtype=np.int64)
    # A forbidden pair costs more than all allowed ones together could save.
    spread = float(np.ptp(cost[allowed])) + 1.0
    beyond = float(cost[allowed].max()) + spread * (min(cost.shape) + 1)
    filled = np.where(allowed, cost, beyond)
    column = _shortest_paths(filled) if len(cost) <= cost.shape[1] else _inverse(filled)
    pairs = np.stack([np.arange(len(cost)), column], axis=1)[column >= 0]
    kept: Index = pairs[allowed[pairs[:, 0], pairs[:, 1]]]
    return kept


def _inverse(cost: Array) -> Index:
    column = np.full(len(cost), -1, dtype=np.int64)
    row_of = _shortest_paths(cost.T)
    column[row_of] = np.arange(cost.shape[1])
    return column


def _shortest_paths(cost: Array) -> Index:
    """Column of every row (R,), R ≤ C, by successive shortest augmenting paths with potentials.

    Jonker & Volgenant, A shortest augmenting path algorithm for dense and sparse linear assignment problems,
    Computing 38, 1987.
    """
    n_rows, n_columns = cost.shape
    row_price, column_price = np.zeros(n_rows), np.zeros(n_columns + 1)
    owner = np.full(n_columns + 1, -1, dtype=np.int64)  # the last column is where a path begins
    for row in range(n_rows):
        owner[-1], at = row, n_columns
        distance = np.full(n_columns, np.inf)
        came_from = np.full(n_columns, n_columns, dtype=np.int64)
        done = np.zeros(n_columns + 1, dtype=bool)
        while owner[at] >= 0:
            done[at] = True
            step = cost[owner[at]] - row_price[owner[at]] - column_price[:-1]
            shorter = ~done[:-1] & (step < distance)
            distance[shorter], came_from[shorter] = step[shorter], at
            at = int(np.where(done[:-1], np.inf, distance).argmin())
            least = distance[at]
            row_price[owner[done]] += least
            column_price[done] -= least
            distance[~done[:-1]] -= least
        while at != n_columns:
            owner[at], at = owner[came_from[at]], int(came_from[at])
    column = np.empty(n_rows, dtype=np.int64)
    taken = np.flatnonzero(owner[:-1] >= 0)
    column[owner[taken]] = taken
    return column
