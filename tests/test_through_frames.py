"""Stacks from both sides of a swatch, brought to one frame."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.against_light import cut_alike

WHOLE = np.arange(12 * 10, dtype=np.float32).reshape(1, 12, 10, 1).repeat(3, -1)


def cut_off(left: int, top: int, right: int, bottom: int) -> PhotoStack:
    """A stack of 10 x 12 whose alignment took these borders."""
    images = WHOLE[:, top : 12 - bottom, left : 10 - right]
    return PhotoStack(images, ("a",), None, False, (), {"frame": {"border_cut": [left, top, right, bottom]}})


def test_both_lose_what_either_lacks() -> None:
    front, behind = cut_alike(cut_off(1, 0, 2, 0), cut_off(0, 3, 1, 1))
    expected = WHOLE[:, 3:11, 1:8]
    np.testing.assert_array_equal(front.images, expected)
    np.testing.assert_array_equal(behind.images, expected)


def test_what_was_not_cut_stays_itself() -> None:
    stacks = cut_off(0, 0, 0, 0), cut_off(0, 0, 0, 0)
    assert all(cut is stack for cut, stack in zip(cut_alike(*stacks), stacks, strict=True))


def test_another_frame_is_refused() -> None:
    other = PhotoStack(WHOLE[:, :, :8], ("a",), None, False, (), {"frame": {"border_cut": [0, 0, 1, 0]}})
    with pytest.raises(BakeError, match="10 x 12 and 9 x 12"):
        cut_alike(cut_off(0, 0, 0, 0), other)
