"""The four modes: what a material spends on each sample (addon/docs/method.md, section 9)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

Mode = Literal["preview", "balanced", "exact", "reference"]
MODES: tuple[str, ...] = get_args(Mode)
"""
preview     native closures alone, close to the measurement and of its albedo; what EEVEE shows too
balanced    exact for what is seen directly or in a mirror, preview after a diffuse bounce
exact       native closures under the measurement and a stochastic mirror for the rest, everywhere
reference   a stochastic mirror from the table alone
"""
# The table that a mode's mirror follows. Under the residual's lie the closures of the envelope.
TABLE_OF: Mapping[str, str] = {"balanced": "residual", "exact": "residual", "reference": "table"}
