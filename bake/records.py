"""The record of a bundle of either kind."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .brdf.common import kind_of
from .brdf.record import BrdfRecord
from .bundle import MATERIAL, Bundle
from .shading.record import ShadingMapRecord

Record = BrdfRecord | ShadingMapRecord


def read_record(bundle: Bundle) -> Record:
    """Of a bundle. Raises BakeError where an entry is missing or wrong."""
    return parse_record(bundle.material, bundle.path / MATERIAL, bundle)


def parse_record(document: Mapping[str, Any], where: str | Path, bundle: Bundle | None = None) -> Record:
    """Of a document from anywhere, named `where` in errors. Raises BakeError as `read_record`."""
    kind = ShadingMapRecord if kind_of(document) == "shading_map" else BrdfRecord
    return kind.parse(document, where, bundle)
