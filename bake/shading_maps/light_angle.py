"""Which level of the map the photograph shows that was taken with the light at some angle: for the angular lookup."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Knots, even in the cosine of the light's angle to the normal.
ANGLE_KNOTS = 9


def level_by_cosine(directions: NDArray[Any] | None, levels: NDArray[np.float64]) -> list[float]:
    """Level x of the photograph taken with the light at each of `ANGLE_KNOTS` cosines from 0 to 1, for "angular".

    Between the photographs it is interpolated, and from the lowest one down to 0 at the horizon. Without known
    directions the swatch is taken for a Lambertian.
    """
    knots = np.linspace(0, 1, ANGLE_KNOTS)
    if directions is None:
        return knots.tolist()
    cosines = np.clip(directions[:, 2], 0, 1)
    order = np.argsort(cosines, kind="stable")
    x, y = np.concatenate([[0.0], cosines[order]]), np.concatenate([[0.0], levels[order]])
    return np.clip(np.interp(knots, x, y), 0, 1).tolist()
