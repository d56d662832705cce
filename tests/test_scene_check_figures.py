"""The numbers that the scene check shows users, each held to half and one and a half times of what a render shows."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake.bundle.bundle import Bundle
from support.checked_scenes import bundle, clean_blend  # noqa: F401
from support.scene_check_figures import FIGURES, NUMBERS, UNMEASURED, Figure, measured, sentences


def test_every_figure_is_measured_or_has_its_reason() -> None:
    """What stands in the rules, no more and no less."""
    text = " ".join(line.strip().strip('"') for line in sentences().splitlines())
    told = {match.group() for match in NUMBERS.finditer(text)}
    assert len(told) > 25
    known = {NUMBERS.search(figure.words).group() for figure in FIGURES}  # type: ignore[union-attr]
    assert told - known - set(UNMEASURED) == set()
    assert not (known | set(UNMEASURED)) - told
    for figure in FIGURES:
        assert figure.words in text, figure.words


@pytest.mark.slow
@pytest.mark.parametrize("figure", FIGURES, ids=[figure.words for figure in FIGURES])
def test_figure(bundle: Bundle, figure: Figure) -> None:
    """Seeds differ by less than a tenth of the change in all but the rarest samples."""
    changes = measured(bundle, figure) * figure.sign
    low, high = figure.told
    assert 0.5 * low < np.mean(changes) < 1.5 * high, changes
    assert np.all(changes > 0), changes
