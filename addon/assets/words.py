"""What an asset says of a measured material: only what its record states, and nothing that one could guess."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ...bake.brdf.record import BrdfRecord
from ...bake.shading_maps.record import Record
from ..summary.brdf_rows import error_rows
from ..summary.shading_map_rows import map_error_rows
from ..summary.text import capital, one_line
from .catalogue import ROOT

# Classes of material by words of their names, as the measured databases call them; a paint with metal in it is a paint.
_CLASSES = {
    "Paint": {"paint", "paints", "lacquer", "varnish"},
    "Metal": {"metal", "steel", "chrome", "brass", "bronze", "copper", "aluminium", "aluminum", "nickel", "tungsten"},
    "Cloth": {"cloth", "fabric", "felt", "velvet", "satin", "silk", "denim", "suede", "cotton", "linen", "wool"},
    "Leather": {"leather"},
    "Paper": {"paper", "cardboard"},
    "Plastic": {"plastic", "teflon", "nylon", "pvc", "delrin", "polyethylene"},
    "Wood": {"wood", "oak", "maple", "walnut", "cherry", "pine"},
    "Stone": {"stone", "marble", "granite", "limestone"},
}
_MOST = 1000  # letters of a text that a file states


@dataclass(frozen=True)
class Rights:
    """Who made a measurement, and what may be done with it; empty where nobody said."""

    author: str = ""
    license: str = ""
    copyright: str = ""


@dataclass(frozen=True)
class AssetWords:
    """All that an asset tells."""

    catalogue: str
    description: str
    tags: tuple[str, ...]
    rights: Rights


def words_of(record: Record) -> AssetWords:
    """Words on a baked material, isotropic, anisotropic or of photographs."""
    shelf, kind = _shelf_of(record)
    format_ = record.source.format if shelf == "Measurements" else None
    anisotropic = isinstance(record, BrdfRecord) and record.anisotropic
    tags = [kind, format_, "Anisotropic" if anisotropic else None, _class_of(record.name)]
    return AssetWords(
        f"{ROOT}/{shelf}", _description(record, kind, format_), tuple(tag for tag in tags if tag), rights_of(record)
    )


def rights_of(record: Record) -> Rights:
    """Author, licence and copyright as far as whoever baked it, or else what was measured, states them."""
    stated = record.rights.facts()
    return Rights(*(stated.get(key) or _text(record, key) for key in ("author", "license", "copyright")))


def _shelf_of(record: Record) -> tuple[str, str]:
    """Last part of the catalogue, and the tag of the kind."""
    if not isinstance(record, BrdfRecord):
        return "Photographs", "Photographed"
    return ("Formulas", "Formula") if record.source.format == "analytic" else ("Measurements", "Measured")


def _class_of(name: str) -> str | None:
    found = set(re.split(r"[^a-z]+", name.lower()))
    return next((tag for tag, words in _CLASSES.items() if found & words), None)


def _description(record: Record, kind: str, format_: str | None) -> str:
    """Two or three sentences: what it is, what the measurement says of itself, how far it errs."""
    how = {
        "Measured": f"Measured reflectance ({format_})" if format_ else "Measured reflectance",
        "Formula": f"Reflectance by the formula {record.source.facts.get('model', record.name)}",
        "Photographed": "Flat swatch, photographed under a moved lamp",
    }[kind]
    sentences = [f"{how}: {one_line(record.name)}"]
    if (said := _text(record, "description")) and said != record.name:
        sentences.append(capital(said))
    if isinstance(record, BrdfRecord):
        rows = dict(error_rows(record))
        sentences.append(f"RMS error {rows['RMS error']} ({rows['Relative']})")
    else:
        rows = dict(map_error_rows(record))
        sentences.append(f"Error of a photograph that was left out {rows['Left-out error']}")
    if record.rights.source_url:
        sentences.append(f"Found at {record.rights.source_url}")
    return " ".join(sentence.rstrip(".") + "." for sentence in sentences)


def _text(record: Record, key: str) -> str:
    found = record.source.facts.get(key)
    return one_line(found)[:_MOST] if isinstance(found, str) else ""
