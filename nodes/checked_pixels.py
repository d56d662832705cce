"""A bundle's pixels, checked before Blender is given them: once for each content, however many materials are built."""

from __future__ import annotations

from collections.abc import Callable

from ..bake.brdf.baked_table import BakedTable
from ..bake.brdf.grids import is_anisotropic
from ..bake.brdf.record import BrdfRecord
from ..bake.bundle.bundle import Bundle
from ..bake.sampling.concentration import concentration
from . import portions
from .data_image import LoadedBundle
from .texture_content import file_content, image_content

_MOST = 4096
# SHA-256 of images, and what they were found fit for.
_fit: set[tuple[str, str]] = set()
# The same of samplers, with their layouts, and how concentrated their draws are.
_concentrations: dict[tuple[str, str], float] = {}


def check_once(bundle: Bundle, name: str, purpose: str, check: Callable[[], object]) -> None:
    """Call `check`, which raises BakeError where image `name` cannot serve, unless this content has passed it before.

    Whoever shares a bundle may have changed its pixels: that they still are this content is looked at every time.

    Parameters
    ----------
    purpose : all that the check goes by beside the pixels
    """
    sha256 = str(bundle.material["images"][name]["sha256"]) if bundle.has(name) else ""
    if (sha256, purpose) in _fit and _content(bundle, name) == sha256:
        return
    portions.rest()
    check()
    if len(_fit) >= _MOST:
        _fit.clear()
    _fit.add((sha256, purpose))


def _content(bundle: Bundle, name: str) -> str | None:
    if isinstance(bundle, LoadedBundle):
        return image_content(bundle.texture(name))
    return file_content(bundle.image_path(name))


def check_image(bundle: Bundle, name: str) -> None:
    """Raise BakeError where the image is not the one that was baked, or not finite."""
    check_once(bundle, name, "image", lambda: bundle.load(name))


def check_table(table: BakedTable) -> None:
    """Raise BakeError where a table or its sampler are not those that were baked, or would lead out of them."""
    check_image(table.bundle, table.part)
    check_once(table.bundle, table.sampler, f"sampler {table.layout}", table.load_sampler)


def concentration_of(table: BakedTable) -> float:
    """`bake.sampling.concentration` of a table's sampler that has been checked."""
    images = table.bundle.material["images"]
    key = (str(images[table.sampler]["sha256"]), str(table.layout))
    if key not in _concentrations:
        if len(_concentrations) >= _MOST:
            _concentrations.clear()
        _concentrations[key] = concentration(table.load_sampler().sample, is_anisotropic(table.stored.grid))
    return _concentrations[key]


def check_closures(record: BrdfRecord, part: str) -> None:
    """Raise BakeError where there is no "envelope" or no "preview_weights", or they are none."""
    described, load = (
        (record.envelope, record.load_envelope) if part == "envelope" else (record.preview, record.load_preview)
    )
    told = (described.closures, described.viewers) if described is not None else ()
    check_once(record.files(), part, f"closures {told}", load)


def check_shares(record: BrdfRecord) -> None:
    """Raise BakeError where the image "residual_share" is none."""
    check_once(record.files(), "residual_share", f"shares {record.share_layout}", record.check_shares)
