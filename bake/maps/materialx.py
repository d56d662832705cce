"""Maps as a MaterialX document: an OpenPBR surface that reads the files beside it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from xml.etree import ElementTree

from ..source import Json
from .write import FULL_SPECULAR

# MaterialX's names of colour spaces, by Blender's; data has none.
_SPACES = {"sRGB": "srgb_texture", "Linear Rec.709": "lin_rec709"}
# OpenPBR's index of refraction at which an F0 of 0.04 has a specular_weight of 1.
_IOR, _F0 = 1.5, 0.04
_TYPES = {"albedo": "color3", "normal": "vector3"}
_INPUTS = {
    "base_color": "albedo",
    "specular_roughness": "roughness",
    "specular_weight": "specular",
    "geometry_normal": "normal",
}


def materialx_document(title: str, maps: Mapping[str, Mapping[str, Json]]) -> str:
    """XML of MaterialX 1.39 with a material of these maps, as `write_maps` tells of them.

    Paths are those of files in the document's own folder. The height is an output of its own that nothing is linked to:
    beside the normals, displacement would count the relief twice.
    """
    name = _identifier(title)
    root = ElementTree.Element("materialx", version="1.39", colorspace="lin_rec709")
    graph = ElementTree.SubElement(root, "nodegraph", name=f"NG_{name}")
    for key, about in maps.items():
        _image(graph, key, about)
    _scaled(graph, maps)
    _turned(graph, green_up=maps["normal"].get("green") != "down")
    for key in ("albedo", "roughness", "specular", "normal", "height"):
        source = {"specular": "specular_weight", "normal": "tangent_normal"}.get(key, key)
        ElementTree.SubElement(graph, "output", name=f"out_{key}", type=_TYPES.get(key, "float"), nodename=source)
    surface = ElementTree.SubElement(root, "open_pbr_surface", name=f"SR_{name}", type="surfaceshader")
    for key, value in (("base_weight", "1"), ("base_metalness", "0"), ("specular_ior", f"{_IOR:g}")):
        ElementTree.SubElement(surface, "input", name=key, type="float", value=value)
    for key, source in _INPUTS.items():
        type_ = _TYPES.get(source, "float")
        linked = {"name": key, "type": type_, "nodegraph": f"NG_{name}", "output": f"out_{source}"}
        ElementTree.SubElement(surface, "input", linked)
    material = ElementTree.SubElement(root, "surfacematerial", name=name, type="material")
    ElementTree.SubElement(material, "input", name="surfaceshader", type="surfaceshader", nodename=f"SR_{name}")
    ElementTree.indent(root)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _image(graph: ElementTree.Element, key: str, about: Mapping[str, Json]) -> None:
    node = ElementTree.SubElement(graph, "image", name=key, type=_TYPES.get(key, "float"))
    file = {"name": "file", "type": "filename", "value": str(about["file"])}
    if (space := _SPACES.get(str(about["color_space"]))) is not None:
        file["colorspace"] = space
    ElementTree.SubElement(node, "input", file)


def _scaled(graph: ElementTree.Element, maps: Mapping[str, Mapping[str, Json]]) -> None:
    """specular_weight of F0, which PNG holds in parts of `FULL_SPECULAR`."""
    unit = 1.0 if maps["specular"].get("unit") == "F0" else FULL_SPECULAR
    node = ElementTree.SubElement(graph, "multiply", name="specular_weight", type="float")
    ElementTree.SubElement(node, "input", name="in1", type="float", nodename="specular")
    ElementTree.SubElement(node, "input", name="in2", type="float", value=f"{unit / _F0:g}")


def _turned(graph: ElementTree.Element, *, green_up: bool) -> None:
    node = ElementTree.SubElement(graph, "normalmap", name="tangent_normal", type="vector3")
    ElementTree.SubElement(node, "input", name="in", type="vector3", nodename="normal")
    scale = {"name": "scale", "type": "vector2", "value": "1, 1" if green_up else "1, -1"}
    ElementTree.SubElement(node, "input", scale)


def _identifier(title: str) -> str:
    """A name as MaterialX takes it: letters, digits and underscores, no digit first."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", title) or "swatch"
    return f"_{name}" if name[0].isdigit() else name
