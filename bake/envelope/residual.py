"""What an envelope leaves: a non-negative BRDF of its own, baked as its own table.

The shader adds E, which it evaluates exactly, and the residual's table R; it neither subtracts nor clamps. So E + R is
free of the table's interpolation error wherever E carries the light, and one stochastic tap of R is unbiased.
"""

from __future__ import annotations

import numpy as np

from ..source import Array, Facts
from ..tables.accuracy import DirectionPairs, Reconstructed
from ..tables.table import Filter
from .fitted import EnvelopeFit
from .viewers import Elevations, Source


class ResidualSource:
    """max(f - E / cos(theta_i), 0) as a source, of f as the envelope was fitted to it; the table treats it alike."""

    def __init__(self, source: Source, fit: EnvelopeFit) -> None:
        self.source, self.fit = fit.viewers.treated(source), fit
        self.name = f"{source.name} residual"
        self.isotropic = self.bilateral = isinstance(fit.viewers, Elevations)
        self.facts: Facts = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) >= 0 in 1/sr, finite up to the horizon."""
        wi, wo = np.broadcast_arrays(wi, wo)
        rest: Array = np.maximum(self.source.evaluate(wi, wo) - self.fit.evaluate(wi, wo), 0)
        return rest


def reconstruction_errors(
    source: Source,
    fit: EnvelopeFit,
    residual: Reconstructed,
    whole: Reconstructed,
    pairs: DirectionPairs,
    filter: Filter = "trilinear",
) -> Facts:
    """Errors of E + interp(R) and of interp(f) at directions that no table holds; JSON-ready.

    Where highlights carry the light the former is closer: on metals by half, since E needs no table. On felts, whose
    table is good to a few parts in ten thousand, the envelope's own budget is the larger error.

    Returns
    -------
    "envelope_and_residual", "table" and "overshoot" (E + R without a table), each the RMS in 1/sr and the
    energy-relative error of `bake.tables.accuracy`; "closer": which of the first two has the smaller RMS; and
    "rms_ratio", that of the first over the second
    """
    truth = fit.viewers.treated(source).evaluate(pairs.wi, pairs.wo)
    envelope = fit.evaluate(pairs.wi, pairs.wo)
    together = envelope + residual.evaluate(pairs.wi, pairs.wo, filter)
    found = {
        name: {"rms": pairs.rms(value - truth), "relative": pairs.relative_error(value - truth, truth)}
        for name, value in (
            ("envelope_and_residual", together),
            ("table", whole.evaluate(pairs.wi, pairs.wo, filter)),
            ("overshoot", np.maximum(envelope, truth)),
        )
    }
    ratio = found["envelope_and_residual"]["rms"] / max(found["table"]["rms"], 1e-300)
    return {**found, "closer": "envelope_and_residual" if ratio < 1 else "table", "rms_ratio": ratio}
