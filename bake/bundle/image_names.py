"""File names of a bundle's images, which no other material's have.

Blender and farms' packers flatten folders: *Unpack Resources* writes every image of a .blend by its base name into one
folder, *Find Missing Files* takes the first file of that name. So a name says the material, the content and the image:
`gold-paint_3f2a9c11b0de_table.exr`. Bundles up to schema 2 had `table.exr`.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from typing import Any

_DIGITS = 12  # of the SHA-256: 48 bits, which no library of materials exhausts
_LONGEST_TITLE = 40
_OTHER = re.compile("[^A-Za-z0-9]+")


def title_of(material: Mapping[str, Any], otherwise: str) -> str:
    """Title that images are named after: the name of the measurement as material.json has it."""
    source = material.get("source")
    name = source.get("name") if isinstance(source, Mapping) else None
    return name if isinstance(name, str) else otherwise


def unique_name(title: str, image: str, sha256: str, suffix: str) -> str:
    """A base name for an image of this material and of this content.

    Parameters
    ----------
    title : of the material, in any language; letters that some file system or packer may change are left out
    image : what it is, such as "table"; last, for whoever takes a trailing number for a frame
    sha256 : of the file's content, in hexadecimal
    suffix : of the file, with its dot
    """
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
    slug = _OTHER.sub("-", plain).strip("-")[:_LONGEST_TITLE].rstrip("-") or "material"
    return f"{slug}_{sha256[:_DIGITS]}_{image}{suffix}"


def common_name(image: str, suffix: str) -> str:
    """File name that every bundle up to schema 2 gave this image."""
    return image + suffix


def is_unique_name(file: str, image: str, suffix: str) -> bool:
    """Whether this is what `unique_name` gives to some material's image: a plain name, no path, no hidden file."""
    pattern = rf"[A-Za-z0-9][A-Za-z0-9-]*_[0-9a-f]{{{_DIGITS}}}_{re.escape(image)}{re.escape(suffix)}"
    return len(file) <= 2 * _LONGEST_TITLE + 20 and re.fullmatch(pattern, file) is not None
