"""Published parameter sets (`.json`): SGD (Bagher et al. 2012) and ABC (Low et al. 2012) fits of the MERL materials.

The document has an object `materials` of one object of parameters each, or is one such object itself. Which formula
they belong to follows from their names. Of several materials one has to be chosen by its name, or by the other name
under which the same authors list it (`otherName`).
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import BakeError
from ...reading import Reading
from ...source import Array, Json, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import beginning, checked_bytes, printable
from .formulas import ABC_PARAMETERS, SGD_PARAMETERS, Parameters, abc, shifted_gamma

MAX_BYTES = 16 << 20
_REMEDY = "give a JSON file of SGD or ABC parameters: an object 'materials' of objects with their names"
_Formula = Callable[[Array, Array, Parameters], Array]
_MODELS: dict[str, tuple[str, dict[str, tuple[int, float, float]], _Formula]] = {
    "SGD": ("Shifted Gamma distribution (Bagher et al. 2012)", SGD_PARAMETERS, shifted_gamma),
    "ABC": ("ABC distribution (Low et al. 2012)", ABC_PARAMETERS, abc),
}
_SHOWN = 8


def read(path: Path, reading: Reading) -> LookupSource:
    """The material of a file that `reading.material` names; needed where there are several.

    Raises
    ------
    BakeError : no such file, damaged, no material of that name (the nearest are listed), none chosen of several
    """
    document = _document(path)
    materials = _materials(path, document)
    name = _chosen(path, materials, reading.material)
    entries = materials[name]
    model = next((key for key, (_, wanted, _) in _MODELS.items() if wanted.keys() <= entries.keys()), None)
    if model is None:
        raise BakeError(path, f"{printable(name, 60)!r} has the parameters of neither SGD nor ABC", _REMEDY)
    label, wanted, formula = _MODELS[model]
    parameters = {key: _numbers(path, name, key, entries[key], *bounds) for key, bounds in wanted.items()}
    facts: dict[str, Json] = {
        "format": f"published {model} fit",
        "model": label,
        "material": printable(name, 100),
        "materials_in_file": len(materials),
        "parameters": {key: value.tolist() for key, value in parameters.items()},
        "interpolation": "none: a formula",
        "comments": [printable(document["source"])] if isinstance(document.get("source"), str) else [],
    }
    other = entries.get("otherName")
    if isinstance(other, str) and other and other != name:
        facts["also_called"] = printable(other, 100)
    title = printable(name, 100) if len(materials) > 1 else path.stem
    return LookupSource(title, lambda wi, wo: formula(wi, wo, parameters), facts, isotropic=True, bilateral=True)


def chosen(path: Path, reading: Reading) -> str:
    """Name of the material that `read` takes, as the file has it; "" where there is but one. Raises BakeError."""
    materials = _materials(path, _document(path))
    name = _chosen(path, materials, reading.material)
    return printable(name, 100) if len(materials) > 1 else ""


def listed(path: Path) -> list[str]:
    """Names of the materials; none where there is but one. Raises BakeError."""
    materials = _materials(path, _document(path))
    return [printable(name, 100) for name in materials] if len(materials) > 1 else []


def _document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(checked_bytes(path, _REMEDY, MAX_BYTES).decode("utf-8"))
    except RecursionError as error:
        raise BakeError(path, "is nested too deeply", _REMEDY) from error
    except ValueError as error:
        raise BakeError(path, f"is not valid JSON ({printable(str(error), 120)})", _REMEDY) from error
    if not isinstance(document, dict):
        raise BakeError(path, "is not a JSON object", _REMEDY)
    return document


def _materials(path: Path, document: dict[str, Any]) -> dict[str, dict[str, Any]]:
    listed = document.get("materials", {path.stem: document})
    if not isinstance(listed, dict) or not listed:
        raise BakeError(path, "lists no materials", _REMEDY)
    if not all(isinstance(entry, dict) for entry in listed.values()):
        raise BakeError(path, "lists a material that is no object of parameters", _REMEDY)
    return listed


def _chosen(path: Path, materials: dict[str, dict[str, Any]], wanted: str) -> str:
    """The name under which the material stands."""
    if not wanted:
        if len(materials) == 1:
            return next(iter(materials))
        shown = ", ".join(printable(name, 40) for name in list(materials)[:_SHOWN])
        more = f" and {len(materials) - _SHOWN} more" if len(materials) > _SHOWN else ""
        raise BakeError(path, f"holds {len(materials)} materials: {shown}{more}", "choose one by its name (--material)")
    names = {_plain(name): name for name in materials}
    others = {_plain(str(entry.get("otherName", ""))): name for name, entry in materials.items()}
    found = names.get(_plain(wanted)) or (others.get(_plain(wanted)) if _plain(wanted) else None)
    if found is None:
        near = difflib.get_close_matches(_plain(wanted), [*names, *filter(None, others)], 3, 0.4)
        help_ = f"choose one of its {len(materials)}" + (f", such as {printable(', '.join(near), 150)}" if near else "")
        raise BakeError(path, f"holds no material {printable(wanted, 60)!r}", help_)
    return found


def _plain(name: str) -> str:
    """A name as it is compared: capitals, blanks, hyphens and underscores do not count."""
    return re.sub(r"[\s_\-]+", "-", name.strip().lower())


def _numbers(path: Path, material: str, key: str, value: object, count: int, least: float, most: float) -> Array:
    listed = value if isinstance(value, list) else [value]
    numbers = [v for v in listed if isinstance(v, int | float) and not isinstance(v, bool)]
    # NaN fails this, and so do whole numbers too long for a float.
    if not len(numbers) == len(listed) == count or not all(least <= v <= most for v in numbers):
        kind = "three numbers" if count > 1 else "a number"
        cause = f"{printable(material, 60)!r} has no {key} that is {kind} from {least:g} to {most:g}"
        raise BakeError(path, cause, _REMEDY)
    return np.array(numbers, dtype=float)


def _matches(path: Path, head: bytes) -> bool:
    """An object that begins with a model's parameters, or with a list of materials that have them."""
    if head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] != b"{":
        return False
    data = beginning(path)
    return any(all(f'"{key}"'.encode() in data for key in wanted) for _, wanted, _ in _MODELS.values())


READER = Reader("published SGD or ABC fit", (".json",), _matches, read, chosen, listed)
