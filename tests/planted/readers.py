"""Readers of measurements."""

from __future__ import annotations

from .mistake import Mistake

MISTAKES = (
    Mistake(
        "merl-green-scale",
        "bake/sources/merl.py",
        "1.15 / 1500",
        "1.0 / 1500",
        ("tests/test_merl.py::test_layout_is_merls",),
        "green 13 % too dark in every MERL material",
    ),
)
