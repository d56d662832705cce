"""Photographs of an evenly white board, which take the unevenness of a near lamp and of the lens out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import Facts
from .calibration import flat_gain
from .development import Development
from .encoding import choose_encoding
from .folder import find_photographs
from .frame import Placement
from .light_files.entry import name_key
from .photograph import Decoder, read_photograph
from .settings import Rectangle

Gain = NDArray[np.float32]


class FlatField:
    """Divisors for the swatch and for the white card, from one photograph of the board or one per light.

    Each channel is normalised to mean 1 over the swatch: only the unevenness goes, not the lamp's colour or strength.
    """

    def __init__(
        self, source: Path, rule: str, turn_upright: bool, size: tuple[int, int], decoder: Decoder | None
    ) -> None:
        self._rule, self._turn, self._size, self._decoder = rule, turn_upright, size, decoder
        self._by_stem: dict[str, Path] | None = None
        if source.is_dir():
            paths, _ = find_photographs(source, ())
            self._by_stem = {name_key(path.stem): path for path in paths}
        self._source = source
        self._cached: tuple[Gain, NDArray[np.float64] | None] | None = None
        self.facts: Facts = {"source": source.name, "per_photograph": self._by_stem is not None}

    def gains(
        self, names: list[Path], placement: Placement, card: Rectangle | None
    ) -> tuple[Gain, NDArray[np.float64] | None]:
        """Divisor (H, W, 3) of the swatch and (3,) of the card for the photographs of one light. Raises BakeError."""
        if self._cached is not None:
            return self._cached
        file = self._source if self._by_stem is None else self._of(names)
        photo = read_photograph(file, self._decoder)
        encoding = choose_encoding(file, photo.info, self._rule)
        view = Development([file], [photo], [encoding], [1.0], self._turn)
        if view.size != self._size:
            cause = f"is {view.size[0]} x {view.size[1]}, the photographs are {self._size[0]} x {self._size[1]}"
            raise BakeError(file, cause, "photograph the board with the same camera, uncropped")
        gain, means = flat_gain(file, view.swatch(placement))
        if view.counts.clipped_share > 0.01:
            raise BakeError(file, "is clipped", "expose the board more shortly")
        at_card = None
        if card is not None:
            at_card = view.mean(card)[0] / means
            if not at_card.min() > 0.01:
                raise BakeError(file, "is black at the white card", "let the board cover the card's place too")
        if self._by_stem is None:
            self._cached = gain, at_card
        return gain, at_card

    def _of(self, names: list[Path]) -> Path:
        assert self._by_stem is not None
        for path in names:
            if found := self._by_stem.get(name_key(path.stem)):
                return found
        raise BakeError(self._source, f"holds no board for {names[0].name}", "name the boards as the photographs")
