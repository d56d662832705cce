"""OSL shaders as Script nodes.

The node holds the compiled shader itself (mode Internal), so that a .blend needs no file of this extension and nothing
is written beside it. Cycles then compiles a copy of the text in a temporary folder, where an `#include` finds Cycles'
own headers but not those beside our shaders: they are put into the text here.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.machinery
import importlib.util
import itertools
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import bpy

from ..bake.errors import BakeError
from ..bake.images.image_io import load_openimageio
from . import compat, expr
from .group import trees_below

SHADERS = Path(__file__).parent / "osl"
# Custom property of groups of nodes whose rays are scripts (`nodes.light_ray`).
SCRIPTED_KEY = "measured_materials_scripted"
# Parameters that a script has which shows a material.
_OF_WHOLE = {"Mode", "Table", "Normals"}
_numbers = itertools.count()
_INCLUDE = re.compile(r'^#include "(.+)"$')


def shader_source(name: str) -> str:
    """A shader of `nodes/osl`, "measured_lookup.osl" and its like, with our own headers in their places."""
    return with_headers(name, (SHADERS / name).read_text(encoding="utf-8"))


def with_headers(name: str, text: str) -> str:
    """A shader's text with our own headers in it, each once; `#line` keeps the compiler's messages to the point."""
    return "\n".join(_lines(name, text, set())) + "\n"


def _lines(name: str, text: str, seen: set[str]) -> Iterator[str]:
    yield f'#line 1 "{name}"'
    for number, line in enumerate(text.splitlines(), 1):
        found = _INCLUDE.match(line)
        header = SHADERS / found[1] if found else None
        if header is None or not header.is_file():
            yield line
            continue
        if header.name not in seen:
            seen.add(header.name)
            yield from _lines(header.name, header.read_text(encoding="utf-8"), seen)
        yield f'#line {number + 1} "{name}"'


def script_node(name: str, source: str, inputs: Mapping[str, Any]) -> Any:
    """A Script node of this shader in the tree under construction (`expr.building`), compiled.

    Parameters
    ----------
    name : of the text that holds the source; one of this name and content is used again
    source : without headers of ours, see `shader_source`
    inputs : by the names of the shader's parameters: expressions or constants. Those of constants are hidden

    Raises
    ------
    BakeError : this Blender has no OSL, or the shader does not compile
    """
    expr.need_tree()
    require_osl()
    text, fresh = _text(name, source)
    # With a label of its own: `expr.node` would return an equal node, and it has no inputs to differ in yet.
    node = expr.node("ShaderNodeScript", {"mode": "INTERNAL", "label": str(next(_numbers))}, {})
    node.label = ""
    try:
        _compile(node, text, name)
        sockets = {socket.identifier: socket for socket in node.inputs}
        for parameter, value in inputs.items():
            expr.feed(node.id_data, sockets[parameter], value)
            sockets[parameter].hide = not sockets[parameter].is_linked
    except Exception:
        node.id_data.nodes.remove(node)
        if fresh:
            bpy.data.texts.remove(text)
        raise
    return node


def output(node: Any, name: str) -> Any:
    """An output of a Script node as an expression, by the shader's name of it."""
    socket = next(s for s in node.outputs if s.identifier == name)
    return expr.Vector(socket) if socket.type in ("VECTOR", "RGBA") else expr.Scalar(socket)


def is_scripted(material: bpy.types.Material) -> bool:
    """Whether anything in the material is a Script node, which needs OSL."""
    trees = trees_below(material.node_tree) if material.node_tree is not None else ()
    return any(node.bl_idname == "ShaderNodeScript" for tree in trees for node in tree.nodes)


def is_one_script(material: bpy.types.Material) -> bool:
    """Whether the material is a script as a whole, rather than nodes that a script tells what their rays meet, or that
    an artist has given a script of his own."""
    trees = list(trees_below(material.node_tree)) if material.node_tree is not None else []
    whole = any(_is_whole(node) for tree in trees for node in tree.nodes)
    return whole and not any(SCRIPTED_KEY in tree for tree in trees)


def _is_whole(node: bpy.types.Node) -> bool:
    """Whether it is a script of ours that shows a material, or a side of one: these alone know modes."""
    return node.bl_idname == "ShaderNodeScript" and _OF_WHOLE <= {socket.identifier for socket in node.inputs}


def require_osl() -> None:
    """Raise BakeError where this Blender cannot compile OSL."""
    if why_not := why_no_osl():
        raise BakeError("Open Shading Language", why_not, "use the material of nodes, which needs no OSL")


def why_no_osl() -> str:
    """Why this Blender cannot compile OSL; empty if it can."""
    compat.ensure_cycles()
    try:
        built_in = bool(importlib.import_module("_cycles").with_osl)
    except (ImportError, AttributeError):
        built_in = False
    if not built_in:
        return "is not part of this Blender"
    return "" if _has_oslquery() else "lacks Blender's module oslquery"


def use_osl(scene: bpy.types.Scene) -> None:
    """Let a scene render with OSL, which needs Cycles on the CPU; Script nodes are black otherwise."""
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.shading_system = "CPU", True


def _has_oslquery() -> bool:
    """Whether Cycles will find oslquery. The bpy wheel brings it in a folder that is off Python's path.

    That folder holds a numpy of its own too, so the module alone is taken from it.
    """
    load_openimageio()  # which oslquery imports, and which lies in the same folder
    with contextlib.suppress(ImportError):
        importlib.import_module("oslquery")
        return True
    root = Path(bpy.utils.resource_path("LOCAL")) / "python" / "lib"
    for folder in (*root.glob("python*/site-packages"), root / "site-packages"):
        spec = importlib.machinery.PathFinder.find_spec("oslquery", [str(folder)])
        if spec is None or spec.loader is None:
            continue
        module = importlib.util.module_from_spec(spec)
        sys.modules["oslquery"] = module
        try:
            spec.loader.exec_module(module)
        except ImportError:
            del sys.modules["oslquery"]
            continue
        return True
    return False


def _text(name: str, source: str) -> tuple[bpy.types.Text, bool]:
    """The text of this name and content, and whether it is new."""
    for text in bpy.data.texts:
        if text.name.startswith(name) and text.as_string() == source:
            return text, False
    text = bpy.data.texts.new(name)
    text.from_string(source)
    return text, True


def _compile(node: bpy.types.Node, text: bpy.types.Text, name: str) -> None:
    """Give a Script node its shader and, by compiling it, its sockets. Raises BakeError."""
    reports: list[str] = []
    update: Callable[..., Any] = importlib.import_module("cycles.osl").update_script_node
    with _error_stream() as written:
        node.script = text
        # This has compiled it already if the engine of the scene shown is Cycles, and nothing else would.
        if not node.outputs:
            update(node, lambda kind, message: reports.append(message) if "ERROR" in kind else None)
    if node.outputs:
        _forget_folders(node)
        return
    told = [line for line in written() if "error" in line.lower()] or reports or ["no outputs"]
    raise BakeError(
        name,
        f"does not compile as OSL ({told[0].removeprefix('ERROR: ').strip()})",
        "report this with the version of Blender",
    )


def _forget_folders(node: bpy.types.Node) -> None:
    """Take the compiler's command line, which names folders of this machine, out of what the .blend will hold."""
    lines = node.bytecode.splitlines(keepends=True)
    node.bytecode = "".join(line for line in lines if not line.startswith("# options:"))
    node.bytecode_hash = hashlib.md5(node.bytecode.encode(), usedforsecurity=False).hexdigest()


@contextlib.contextmanager
def _error_stream() -> Iterator[Callable[[], list[str]]]:
    """Collect what is written to the error stream, where OSL's compiler complains past Python."""
    lines: list[str] = []
    try:
        before = os.dup(2)
    except OSError:  # a Blender without a console has no such stream
        yield lambda: lines
        return
    with tempfile.TemporaryFile() as file:
        sys.stderr.flush()
        os.dup2(file.fileno(), 2)
        try:
            yield lambda: lines
        finally:
            os.dup2(before, 2)
            os.close(before)
            file.seek(0)
            lines += file.read().decode("utf-8", "replace").splitlines()
