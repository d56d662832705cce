"""Closures of an envelope or of mode Preview, as a material.json lists them."""

from __future__ import annotations

from ..bundle.checked_json import Fields, settings_in
from ..envelope.anisotropic_lobes import LARGEST_RATIO, WIDEST, AnisotropicLobe
from ..envelope.closures import NARROWEST, check_basis
from ..errors import BakeError
from ..lobes.lobes import LOBES, PARAMETERS, Lobe

MOST_CLOSURES = 12


def lobe_of(fields: Fields) -> Lobe:
    """What `Lobe.facts` gave. Raises BakeError."""
    name = fields.text("name", choices=LOBES)
    known = PARAMETERS[name]
    if unknown := [str(key)[:40] for key in fields.entries if key not in {"name", *(p.name for p in known)}]:
        raise BakeError(fields.where, f"lobe '{name}' has no parameter {', '.join(unknown[:3])}", "bake it again")
    return Lobe(name, *(fields.number(p.name, p.low, p.high) for p in known))


def anisotropic_lobe_of(fields: Fields) -> AnisotropicLobe:
    """What `AnisotropicLobe.facts` gave. Raises BakeError."""
    name = fields.text("name", choices=("lambert", "ggx"))
    if name == "lambert":
        return AnisotropicLobe(name)
    widths = [fields.number(key, NARROWEST, WIDEST) for key in ("alpha_x", "alpha_y")]
    if max(widths) > LARGEST_RATIO * min(widths):
        raise BakeError(fields.where, "lists a closure too anisotropic for Cycles", "bake it again")
    return AnisotropicLobe(name, *widths)


def closures_of(fields: Fields, most: int = MOST_CLOSURES) -> tuple[Lobe, ...]:
    """The entry "closures" of an isotropic fit: each native to Cycles, none twice. Raises BakeError."""
    closures = tuple(lobe_of(entry) for entry in fields.parts("closures", 1, most))
    with settings_in(fields.where):
        check_basis(closures)
    return closures


def anisotropic_closures_of(fields: Fields) -> tuple[AnisotropicLobe, ...]:
    """The entry "closures" of an anisotropic fit. Raises BakeError."""
    return tuple(anisotropic_lobe_of(entry) for entry in fields.parts("closures", 1, MOST_CLOSURES))
