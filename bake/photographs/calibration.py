"""From relative values to f cos(theta_i) in 1/sr: by a white card in the frame or by an albedo the artist states.

A lamp of irradiance E on a surface that faces it makes a diffuse card of reflectance rho radiate
L_card = (rho / pi) E cos(theta_i), and the swatch L = f cos(theta_i) E, so that
f cos(theta_i) = L (rho / pi) cos(theta_i) / L_card. E drops out, photograph by photograph.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import Facts

_DARK = 0.05


def flat_gain(file: Path, board: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Divisor (H, W, 3) with mean 1 per channel from a photograph of an even board, and the means (3,) taken out.

    Raises BakeError where the board is black in places.
    """
    means = board.mean(axis=(0, 1), dtype=np.float64)
    if means.min() <= 0:
        raise BakeError(file, "is black", "photograph the board under the light of the swatch")
    gain = (board / means).astype(np.float32)
    if float((gain < _DARK).mean()) > 0.001:
        raise BakeError(file, "is black in places", "let the board fill the crop")
    return np.maximum(gain, np.float32(_DARK)), means


def calibrate_by_card(
    names: list[str],
    images: NDArray[np.float32],
    cards: NDArray[np.float64],
    cosines: NDArray[np.float64] | None,
    reflectance: float,
    word: str = "white card",
) -> Facts:
    """Bring (n, H, W, 3) images to 1/sr in place, given the mean (n, 3) in each of a card, which is called `word`.

    Without the lights' cosines (n,) the brightest card stands for all: its lamp is taken to stand overhead, and the
    lamp to be the same throughout. Each channel has its own factor, which takes the lamp's colour out.

    Raises
    ------
    BakeError : the card is black
    """
    if cosines is None:
        brightest = int(np.argmax(cards.mean(axis=1)))
        cards, cosines = np.broadcast_to(cards[brightest], cards.shape), np.ones(len(cards))
        how = f"{word}, brightest in {names[brightest]}, one lamp for all (no elevations known)"
    else:
        how = f"{word} in every photograph, with the cosine of its light"
    for k, name in enumerate(names):
        if not cards[k].min() > 0:
            raise BakeError(name, f"shows the {word} black", "check its region, or leave the photograph out")
        images[k] *= (reflectance / np.pi * cosines[k] / cards[k]).astype(np.float32)
    return {"by": word, "how": how, "reflectance": reflectance}


def calibrate_by_albedo(
    images: NDArray[np.float32], cosines: NDArray[np.float64] | None, albedo: float, word: str = "albedo"
) -> Facts:
    """Scale (n, H, W, 3) images in place so that their averages follow (albedo / pi) cos(theta_i).

    The albedo is called `word`.

    That is a Lambertian estimate: least squares of the averages where the elevations are known, else the brightest
    photograph is taken as lit from the normal.
    """
    averages = images.mean(axis=(1, 2, 3), dtype=np.float64)
    if cosines is None:
        gain = float(averages.max()) / (albedo / np.pi)
        facts: dict[str, Any] = {"how": f"stated {word}: the brightest photograph averages {word} / pi"}
    else:
        expected = albedo / np.pi * cosines
        gain = float(averages @ expected / (expected @ expected))
        misfit = float(np.sqrt(np.mean((averages / gain - expected) ** 2) / np.mean(expected**2)))
        how = f"stated {word}: least squares of the averages against {word} / pi cos(theta_i)"
        facts = {"how": how, "relative_misfit": round(misfit, 4)}
    images *= np.float32(1 / gain)
    return {"by": word, "albedo": albedo, **facts}
