"""Whether moving a photograph back helps: it must then be closer to what its neighbours foretell.

Light that moves over relief displaces what is seen, and a measurement of displacement cannot distinguish that from a
camera that moved. What the material is baked for can: each photograph is fitted by the two whose lights are nearest,
with free weights and a constant, as it stands, moved back, and moved as far the other way. A movement of the camera
fits better moved back than both; an apparent one, which its neighbours share in part, fits best as it stands.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_NEIGHBOURS = 2
_BLUR = 1.0
"""Standard deviation in pixels: what interpolation smooths must not count as a better fit."""
_MARGIN = 3
_F64 = NDArray[np.float64]


def helpful_moves(gray: _F64, displacement: _F64, chosen: NDArray[np.bool_], apart: _F64) -> _F64:
    """Displacements (n, 2) by which moving back helps, 0 where it does not; one axis alone where the other spoils it.

    A pattern of lines fixes its place across them far better than along them, where it may have moved all the same.

    Parameters
    ----------
    gray : (n, H, W) brightness
    displacement : (n, 2) of the content, x right and y down, pixels
    chosen : (n,) those that would be moved back
    apart : (n, n) how different two photographs' lights are
    """
    moves = np.where(chosen[:, None], displacement, 0.0)
    for _ in range(len(gray)):
        better = np.array([_best(gray, moves, apart, k) if moves[k].any() else moves[k] for k in range(len(gray))])
        if np.array_equal(better, moves):
            break
        moves = better  # those that leaned on one that stays are looked at again
    return moves


def _best(gray: _F64, moves: _F64, apart: _F64, k: int) -> _F64:
    """The move of photograph `k`, or one of its components, or none, that its neighbours foretell best."""
    near = [int(j) for j in np.argsort(apart[k], kind="stable") if j != k][:_NEIGHBOURS]
    border = int(np.ceil(np.abs(moves[[k, *near]]).max())) + _MARGIN
    stay = np.zeros(2)
    if min(gray.shape[1:]) <= 2 * border + _MARGIN:
        return stay
    inner = slice(border, -border), slice(border, -border)
    columns = [_moved(gray[j], moves[j])[inner].ravel() for j in near]
    rows = np.stack([*columns, np.ones_like(columns[0])], axis=-1)

    def misfit(move: _F64) -> float:
        return _misfit(rows, _moved(gray[k], move)[inner].ravel())

    best, least = stay, misfit(stay)
    for axes in ((1, 1), (1, 0), (0, 1)):
        move = moves[k] * axes
        if move.any() and (found := misfit(move)) < min(least, misfit(-move)):
            best, least = move, found
    return best


def _misfit(rows: _F64, target: _F64) -> float:
    """Root of the mean square that no combination of the columns explains."""
    weights = np.linalg.lstsq(rows.T @ rows, rows.T @ target, rcond=None)[0]
    return float(np.sqrt(np.mean((rows @ weights - target) ** 2)))


def _moved(image: _F64, distance: _F64) -> _F64:
    """Values at position + distance, blurred; the borders wrap around, and are not used."""
    fy, fx = np.fft.fftfreq(image.shape[0])[:, None], np.fft.rfftfreq(image.shape[1])
    phase = np.exp(2j * np.pi * (fx * distance[0] + fy * distance[1]) - 2 * np.pi**2 * _BLUR**2 * (fx * fx + fy * fy))
    return np.fft.irfft2(np.fft.rfft2(image) * phase, s=image.shape)
