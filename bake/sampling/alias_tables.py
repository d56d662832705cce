"""Vose's alias method: one number and one table entry draw from any discrete distribution.

Source: Vose 1991, A Linear Algorithm for Generating Random Numbers with a Given Distribution.
"""

from __future__ import annotations

import numpy as np

from ..source import Array


def alias_tables(probability: Array) -> tuple[Array, Array]:
    """Alias tables of several distributions, one per row.

    Parameters
    ----------
    probability : (R, C), each row summing to 1

    Returns
    -------
    acceptance (R, C) in [0, 1] and alias (R, C) integers
    """
    rows, columns = probability.shape
    acceptance = np.ones((rows, columns))
    alias = np.tile(np.arange(columns), (rows, 1))
    for row in range(rows):
        scaled = (probability[row] * (columns / probability[row].sum())).tolist()
        small = [i for i, p in enumerate(scaled) if p < 1]
        large = [i for i, p in enumerate(scaled) if p >= 1]
        while small and large:
            low, high = small.pop(), large[-1]
            acceptance[row, low], alias[row, low] = scaled[low], high
            scaled[high] -= 1 - scaled[low]
            if scaled[high] < 1:
                small.append(large.pop())
    return acceptance, alias
