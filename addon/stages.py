"""Stages of a bake and the time each takes, for estimates."""

from __future__ import annotations

from collections.abc import Mapping

from ..bake.bake_brdf import BakeSettings


def bake_stages(settings: BakeSettings) -> dict[str, float]:
    """Typical seconds of the stages of `bake_file`, in their order."""
    size = (settings.resolution / 64) ** 3
    searches = settings.parameterization == "bezier" and isinstance(settings.alpha, str)
    fits = settings.filter == "bspline" and settings.spline != "plain"
    return {
        "reading": 0.5,
        "choosing alpha": 1 + 2 * size if searches else 0.0,
        "tabulating": 0.5 * size,
        "fitting spline": 2.6 * size if fits else 0.0,
        "sampler": 0.9 + 0.3 * size,
        "measuring": 0.4,
        "writing": 0.4 + 0.2 * size,
    }


def share_done(stages: Mapping[str, float], stage: str, share: float) -> float:
    """Share of the whole, given the share of one stage; 0 for a stage that is not known."""
    if stage not in stages:
        return 0.0
    names = list(stages)
    before = sum(stages[name] for name in names[: names.index(stage)])
    return (before + share * stages[stage]) / max(sum(stages.values()), 1e-9)
