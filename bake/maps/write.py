"""Maps as files, in the conventions of the programs that read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..brdf.preview_sphere import to_srgb
from ..images.image_io import write_image, write_png
from ..images.storage import Storage
from ..source import Facts

NormalConvention = Literal["opengl", "directx"]
"""Which way green points: up the picture (OpenGL: Blender, glTF), or down it (DirectX)."""
NORMAL_CONVENTIONS: tuple[str, ...] = get_args(NormalConvention)
FileKind = Literal["png8", "png16", "exr"]
FILE_KINDS: tuple[str, ...] = get_args(FileKind)
MAP_NAMES = ("normal", "albedo", "height", "roughness", "specular")
# The account that lies beside the files, and what it says of who wrote it.
DOCUMENT, PROGRAM = "maps.json", "measured_materials maps"
MATERIALX = "maps.mtlx"
# F0 of Principled BSDF's IOR Level, or Specular, of 1.
FULL_SPECULAR = 0.08


@dataclass(frozen=True, eq=False)
class Maps:
    """Of one swatch, row 0 on top.

    normal : (H, W, 3) unit vectors, x right, y up, z out of the swatch
    albedo : (H, W, 3), linear Rec.709
    height : (H, W) in widths of the picture, above the mean
    roughness : (H, W) as of Principled BSDF
    reflectance : (H, W), of the gloss at normal incidence (F0)
    """

    normal: NDArray[np.float32]
    albedo: NDArray[np.float32]
    height: NDArray[np.float32]
    roughness: NDArray[np.float32]
    reflectance: NDArray[np.float32]


def write_maps(folder: Path, maps: Maps, convention: NormalConvention, kind: FileKind) -> dict[str, Facts]:
    """Write a file for each map and return what each is, by its name; JSON-ready. Raises BakeError.

    Normals lie in [0, 1], 0.5 being 0. PNG holds albedo encoded as sRGB, heights between the least and the greatest,
    and everything in [0, 1]; EXR holds linear albedo, heights in widths of the picture, and reflectance as it is.
    """
    flip = [1.0, -1.0 if convention == "directx" else 1.0, 1.0]
    normal = 0.5 + 0.5 * maps.normal * np.array(flip, np.float32)
    low, high = float(maps.height.min()), float(maps.height.max())
    exact = kind == "exr"
    span = max(high - low, 1e-12)
    height = maps.height if exact else (maps.height - low) / span
    specular = maps.reflectance if exact else np.clip(maps.reflectance / FULL_SPECULAR, 0, 1)
    planes: Mapping[str, tuple[NDArray[np.float32], Facts]] = {
        "normal": (normal, {"green": "up" if convention == "opengl" else "down", "color_space": "Non-Color"}),
        "albedo": (
            maps.albedo if exact else to_srgb(maps.albedo),
            {"color_space": "Linear Rec.709" if exact else "sRGB"},
        ),
        "height": (
            height[..., None],
            {
                "color_space": "Non-Color",
                "lowest": 0.0 if exact else low,
                "scale": 1.0 if exact else span,
                "midlevel": 0.0 if exact else -low / span,
                "unit": "width of the picture",
            },
        ),
        "roughness": (maps.roughness[..., None], {"color_space": "Non-Color"}),
        "specular": (
            specular[..., None],
            {"color_space": "Non-Color", "unit": "F0" if exact else f"F0 / {FULL_SPECULAR}"},
        ),
    }
    facts: dict[str, Facts] = {}
    for name, (pixels, about) in planes.items():
        file = folder / f"{name}.{'exr' if exact else 'png'}"
        if exact:
            write_image(file, pixels, Storage.FLOAT32)
        else:
            # Of colours that sRGB cannot hold the nearest; 8 bits are enough for them and for gloss.
            wide = kind == "png16" and name in ("normal", "height", "albedo")
            most, dtype = (65535, np.uint16) if wide else (255, np.uint8)
            write_png(file, np.rint(np.clip(pixels, 0, 1) * most).astype(dtype))
        facts[name] = {"file": file.name, **about}
    return facts
