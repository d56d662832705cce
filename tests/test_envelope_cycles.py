"""An envelope as Cycles evaluates it: the narrowest closure's energy, and a sum under its weights."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.envelope import Elevations, EnvelopeFit
from measured_materials.bake.envelope.closures import NARROWEST
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.nodes import expr
from measured_materials.nodes.native_closure import native_closure
from test_native_closures import WEIGHT, Strips, clean_blend, material, native

__all__ = ["clean_blend"]


def test_energy_of_the_narrowest_closure() -> None:
    """Cycles' rounding scatters single values; over the lobe it must cancel, or an envelope would be too bright."""
    lobe, wo, count = Lobe("ggx", NARROWEST), spherical(0.6, 0.0), 200
    u = (np.arange(count) + 0.5) / count
    half = spherical(np.arctan(NARROWEST * np.sqrt(u / (1 - u))), 2 * np.pi * (np.arange(count) * 0.618034 % 1))
    wi = 2 * (half @ wo)[:, None] * half - wo
    with Strips([material(native(lobe))]) as strips:
        found = np.array([strips.radiance(w, wo)[0, 1] for w in wi])
    ratio = found / (lobe.value(wi, wo) * WEIGHT[1] * wi[:, 2])
    # Equal shares of the distribution's energy each: the plain mean. Its standard error is 0.03 %.
    assert abs(ratio.mean() - 1) < 1.5e-3
    assert ratio.std() < 1e-2


def test_a_sum_of_closures_is_the_envelope() -> None:
    """Weights of a viewer between two nodes, added up by shader nodes, against `EnvelopeFit.evaluate`."""
    closures = (Lobe("lambert"), Lobe("ggx", 0.06), Lobe("sheen", 0.7))
    weights = np.random.default_rng(1).random((8, 3, 3)).astype(np.float32)
    fit = EnvelopeFit(closures, Elevations(8), weights, np.zeros(8, np.float32), {})
    wo = spherical(0.9, 0.0)
    colours = fit.weights_at(wo)

    def added(_: Any, normal: Any) -> Any:
        total = None
        for lobe, colour in zip(closures, colours):
            closure = native_closure(lobe, expr.vec(*map(float, colour)), normal)
            both = {0: total, 1: closure}
            total = closure if total is None else expr.Scalar(expr.node("ShaderNodeAddShader", {}, both).outputs[0])
        return total

    lights = [spherical(theta, phi) for theta in (0.1, 0.85, 0.9, 1.4) for phi in (0.0, 1.2, 3.0, np.pi)]
    with Strips([material(added)]) as strips:
        for wi in lights:
            expected = fit.evaluate(wi, wo) * wi[2]
            # Four roundings of a cosine to float32 over alpha^2 = 0.0036.
            assert strips.radiance(wi, wo)[0] == pytest.approx(expected, rel=2e-4)
