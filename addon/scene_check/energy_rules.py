"""Rule of the scene check: a material that an artist has made reflect more light than it receives."""

from __future__ import annotations

from collections.abc import Iterator

from ..material.adjust.energy import energy_of
from ..material.facts import is_measured
from .findings import NOTE, Finding, Subject, editable


def too_bright(subject: Subject) -> Iterator[Finding]:
    """By tint, brightness and saturation; what is linked is not known and not told here."""
    for material in filter(is_measured, subject.wearers):
        energy = energy_of(material)
        if energy is None or energy.mend is None:
            continue
        found, wanted = f"Brightness is {energy.brightness:.4g}", f"{energy.safe_brightness:.4g}"
        told = f"it {energy.verb} up to {energy.largest:.4g} times the light that it receives"
        why = f"{told}, and light between such surfaces grows with every bounce"
        mend = editable(material, energy.mend)
        yield Finding("too_bright", NOTE, f"material {material.name}", found, wanted, why, mend)
