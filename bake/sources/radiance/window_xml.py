"""The XML around measured window layers, as LBNL's WINDOW and Radiance's genBSDF write it.

`read` takes reflection and transmission. Sides are named as Radiance loads them, which its own library confirms:
`Reflection Back` is the front, whose normal is +z. A file that has the other side only is read from that side, and of
one that has neither, only transmission, both sides are black. Light
that `Transmission Front` lets through comes from the back and is seen from the front; where a file has one way only,
the other is its reciprocal, as in Radiance. Both are addressed as reflection is, by where light travels to.

The blocks `Visible` (Y), `CIE-X` and `CIE-Z` of matrices, `CIE-u` and `CIE-v` (u', v' chromaticities) of trees become
linear Rec.709 with the white of D65; without them the material is grey. Blocks of the sun's spectrum are not colours
and are left out. Negative numbers count as 0, as in Radiance.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import BakeError
from ...patches import KLEMS
from ...reading import Reading
from ...source import Array, Reader
from ...spectrum import xyz_to_rec709
from ..lookup.lookup_source import LookupSource
from ..lookup.sheet_lookup import Lookup, SheetLookup, exchanged
from ..lookup.text_file import beginning, checked_bytes, printable
from .klems import klems_lookup
from .tensor_tree import tree_lookup

MAX_BYTES = 256 << 20
_REMEDY = "give a BSDF file as WINDOW, genBSDF or pabopto2bsdf wrote it"
_SIDES = {
    "reflection back": "front",
    "reflection front": "back",
    "transmission front": "through",
    "transmission back": "through behind",
}
_OTHER_WAY = {"through": "through behind", "through behind": "through"}
_CHANNELS = {"visible": "Y", "cie-x": "X", "cie-z": "Z", "cie-u": "u", "cie-v": "v"}


@dataclass(frozen=True)
class Layer:
    """A file's layer: its name and maker, its data structure, and its blocks by side and channel."""

    name: str
    structure: str
    blocks: dict[str, dict[str, ElementTree.Element]]
    others: tuple[str, ...]


def read(path: Path, reading: Reading) -> LookupSource:
    """Read a WINDOW or Radiance XML file; of a layer that lets light through a sheet.

    Raises
    ------
    BakeError : not such a file, or the reflection that is asked for is absent, damaged, or of a basis that is not
        known. Another part of which that is so is left out, and told in the fact "left_out"
    """
    layer = read_layer(path)
    side = "back" if "front" not in layer.blocks and "back" in layer.blocks else "front"
    side = side if reading.side == "auto" else reading.side
    # Neither reflection is needed where the file lets light through: then both sides are black.
    transmits = not {"front", "back"} & layer.blocks.keys() and bool(_OTHER_WAY.keys() & layer.blocks.keys())
    if side not in layer.blocks and not transmits:
        what = "reflection" if reading.side == "auto" else f"reflection of its {side}"
        raise BakeError(path, f"holds no {what}", "give a file with a block Reflection Back or Reflection Front")
    facts: dict[str, Any] = {
        "format": "Radiance tensor tree" if layer.structure.startswith("tensortree") else "Klems matrix",
        "comments": [layer.name],
        "side": f"{side}: {_told_side(side, transmits)}",
        "other_blocks": list(layer.others),
        "interpolation": "none: constant within each cell, as in Radiance",
    }
    isotropic = layer.structure == "tensortree3"
    lookups: dict[str, Lookup] = {}
    left_out: dict[str, str] = {}
    patches: set[str] = set()
    for name, blocks in layer.blocks.items():
        try:
            lookups[name], told = _part(path, layer.structure, name, blocks, side == "back")
        except BakeError as error:
            if name == side:
                raise
            left_out[name] = error.cause
            continue
        patches.add(told.get("patches", ""))
        facts |= told if name == side else {}
    # What every part is constant within: of trees, or of several kinds of patches, nothing.
    common = patches.pop() if len(patches) == 1 else ""
    common = common if common in KLEMS else ""
    ways = [way for way in _OTHER_WAY if way in lookups]
    if transmits:
        if not ways:
            raise BakeError(path, f"holds nothing that can be read: {'; '.join(left_out.values())}", _REMEDY)
        lookups[side] = _black
    if left_out:
        facts["left_out"] = "; ".join(f"{name}: {cause}" for name, cause in left_out.items())
    if not ways:
        return LookupSource(path.stem, lookups[side], facts, isotropic, False, patches=common)
    for way in ways:
        lookups.setdefault(_OTHER_WAY[way], exchanged(lookups[way]))
    facts["transmission"] = "both ways" if len(ways) == 2 else "one way, the other by reciprocity"
    behind = lookups.get("back" if side == "front" else "front")
    facts["behind"] = "reflects" if behind else "black: the file holds no reflection of it that can be read"
    seen, other = ("through", "through behind") if side == "front" else ("through behind", "through")
    sheet = lookups[seen], lookups[other], behind
    return SheetLookup(path.stem, lookups[side], facts, isotropic, False, *sheet, patches=common)


def _told_side(side: str, transmits: bool) -> str:
    if transmits:
        return "black, for the file holds no reflection"
    return f"{'Reflection Back' if side == 'front' else 'Reflection Front'} of the file"


def _black(wi: Array, wo: Array) -> Array:
    return np.zeros((len(wi), 3))


def _part(
    path: Path, structure: str, name: str, blocks: dict[str, ElementTree.Element], back: bool
) -> tuple[Lookup, dict[str, Any]]:
    """One side's reflection or transmission in linear Rec.709, read from the front or back; facts. Raises BakeError."""
    make = tree_lookup if structure.startswith("tensortree") else klems_lookup
    channels: dict[str, Lookup] = {}
    facts: dict[str, Any] = {}
    for channel, block in blocks.items():
        channels[channel], told = make(path, structure, block)
        facts |= told if channel == "Y" else {}
    if "Y" not in channels:
        raise BakeError(path, f"holds no block Visible for {name}", _REMEDY)
    return _rgb_lookup(channels, back), {**facts, "colour": _colour_of(channels)}


def read_layer(path: Path) -> Layer:
    """The layer of a file. Raises BakeError."""
    root = _root(path)
    names = [" ".join(printable(e.text or "") for e in root.iter(tag)) for tag in ("Name", "Manufacturer")]
    structures = {(e.text or "").strip().lower() for e in root.iter("IncidentDataStructure")}
    if len(structures) != 1 or not structures <= {"columns", "rows", "tensortree3", "tensortree4"}:
        cause = f"has data of structure {', '.join(sorted(structures))[:40]!r}"
        raise BakeError(path, cause, "give a file of Columns, Rows, TensorTree3 or TensorTree4")
    blocks: dict[str, dict[str, ElementTree.Element]] = {}
    others = []
    for data in root.iter("WavelengthData"):
        wavelength = next((e.text or "" for e in data.iter("Wavelength")), "").strip()
        for block in data.iter("WavelengthDataBlock"):
            direction = " ".join((block.findtext("WavelengthDataDirection") or "").split())
            side, channel = _SIDES.get(direction.lower()), _CHANNELS.get(wavelength.lower())
            if side and channel and channel not in blocks.get(side, {}):
                blocks.setdefault(side, {})[channel] = block
            elif channel != "Y" or not side:
                others.append(printable(f"{wavelength}: {direction}", 60))
    return Layer(" by ".join(filter(None, names)), structures.pop(), blocks, tuple(sorted(set(others))[:20]))


def _root(path: Path) -> ElementTree.Element:
    """The parsed document without namespaces; text that a program logged before it is dropped."""
    data = checked_bytes(path, _REMEDY, MAX_BYTES)
    # These files declare no entities; one that does is not read any further.
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise BakeError(path, "declares entities, which no BSDF file does", _REMEDY)
    start = data.find(b"<?xml")
    start = data.find(b"<WindowElement") if start < 0 else start
    try:
        root = ElementTree.fromstring(data[max(start, 0) :])
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise BakeError(path, f"is no XML ({error})", _REMEDY) from error
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.rpartition("}")[2]
    if root.tag != "WindowElement":
        raise BakeError(path, f"is XML of another kind ({printable(root.tag, 40)})", _REMEDY)
    return root


def _colour_of(channels: dict[str, Lookup]) -> str:
    if {"X", "Z"} <= channels.keys():
        return "CIE X, Y, Z"
    return "Y, u', v'" if {"u", "v"} <= channels.keys() else "grey"


def _rgb_lookup(channels: dict[str, Lookup], back: bool) -> Lookup:
    """Linear Rec.709 of the channels there are; the back is seen in the front's frame turned about y."""
    kind, matrix = _colour_of(channels), xyz_to_rec709().T
    turned = np.array([-1.0, 1.0, 1.0])

    def lookup(wi: Array, wo: Array) -> Array:
        if back:
            wi, wo = wi * turned, wo * turned
        y = channels["Y"](wi, wo)
        if kind == "grey":
            return np.repeat(y[:, None], 3, -1)
        if kind == "CIE X, Y, Z":
            return np.stack([channels["X"](wi, wo), y, channels["Z"](wi, wo)], -1) @ matrix
        u, v = channels["u"](wi, wo), np.maximum(channels["v"](wi, wo), 1e-6)
        x, z = y * 9 * u / (4 * v), y * np.maximum(12 - 3 * u - 20 * v, 0) / (4 * v)
        return np.stack([x, y, z], -1) @ matrix

    return lookup


def _matches(path: Path, head: bytes) -> bool:
    return b"<WindowElement" in beginning(path)


READER = Reader("WINDOW or Radiance XML", (".xml",), _matches, read)
