"""The seams of the four folders: who may import what, read from the source and proved by importing."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import measured_materials
import pytest

ROOT = Path(measured_materials.__file__).parent
BLENDER = {"bpy", "bpy_extras", "bmesh", "mathutils", "gpu", "gpu_extras", "blf", "bl_ui", "idprop"}
IMAGES = {"OpenEXR", "OpenImageIO"}
OPTIONAL = {"scipy", "matplotlib", "rich", "mitsuba", "drjit", "PIL"}

# What each folder may import of the others, and of packages that are not Python's own.
INSIDE = {"bake": {"bake"}, "nodes": {"nodes", "bake"}, "addon": {"addon", "nodes", "bake"}}
OUTSIDE = {
    "bake": {"numpy"} | IMAGES,
    "nodes": {"numpy"} | BLENDER,
    "addon": {"numpy"} | IMAGES | BLENDER,
}


class Import(NamedTuple):
    where: str
    level: int
    module: str
    deferred: bool


def imports(folder: str) -> Iterator[Import]:
    """Every import of a folder; `module` is counted from the repository root if it is relative."""
    for file in sorted((ROOT / folder).rglob("*.py")):
        parts = file.relative_to(ROOT).parts[:-1]
        tree = ast.parse(file.read_text(encoding="utf-8"), str(file))
        at_import = {id(node) for statement in tree.body for node in _run_on_import(statement)}
        for node in ast.walk(tree):
            where = f"{file.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"
            deferred = id(node) not in at_import
            if isinstance(node, ast.Import):
                for alias in node.names:
                    yield Import(where, 0, alias.name, deferred)
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                yield Import(where, 0, node.module or "", deferred)
            elif isinstance(node, ast.ImportFrom):
                above = len(parts) - (node.level - 1)
                base = [*parts[:above], *(node.module.split(".") if node.module else [])]
                # Above the root the name would leave the package: shown as "..", allowed nowhere.
                names = [".."] if above < 0 else [".".join([*base, a.name]) for a in node.names]
                for name in names:
                    yield Import(where, node.level, name, deferred)


def _run_on_import(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes that importing the module executes: function bodies, guards for a missing package and
    blocks for the type checker left out."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.Try):
        return
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
        return
    yield node
    for child in ast.iter_child_nodes(node):
        yield from _run_on_import(child)


@pytest.mark.parametrize("folder", INSIDE)
def test_folder_imports_only_the_folders_below_it(folder: str) -> None:
    wrong = [
        f"{found.where} {found.module}"
        for found in imports(folder)
        if found.level and found.module.split(".")[0] not in INSIDE[folder]
    ]
    assert not wrong


@pytest.mark.parametrize("folder", INSIDE)
def test_package_is_never_imported_by_its_absolute_name(folder: str) -> None:
    # Inside Blender the package is called bl_ext.<repository>.measured_materials.
    wrong = [
        found.where
        for found in imports(folder)
        if found.level == 0 and found.module.split(".")[0] in {"measured_materials", *INSIDE}
    ]
    assert not wrong


@pytest.mark.parametrize("folder", OUTSIDE)
def test_folder_imports_only_what_blender_brings(folder: str) -> None:
    allowed = OUTSIDE[folder] | set(sys.stdlib_module_names)
    # The command line and the report of `addon` may use more, inside the function which does.
    deferred_too = OPTIONAL if folder == "addon" else set()
    wrong = [
        f"{found.where} {found.module}"
        for found in imports(folder)
        if found.level == 0
        and (name := found.module.split(".")[0]) not in allowed
        and not (found.deferred and name in deferred_too)
    ]
    assert not wrong


IMPORT_ALL = """
import importlib, pkgutil, sys, warnings

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"blocked: {{name}}", name=name)

sys.meta_path.insert(0, Blocked())
warnings.simplefilter("error")
import measured_materials
package = importlib.import_module("measured_materials.{folder}")
names = [module.name for module in pkgutil.walk_packages(package.__path__, package.__name__ + ".")]
for name in names:
    importlib.import_module(name)
print(len(names))
"""


def import_all(folder: str, blocked: set[str]) -> int:
    code = IMPORT_ALL.format(folder=folder, blocked=blocked)
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def test_bake_imports_with_numpy_alone() -> None:
    assert import_all("bake", BLENDER | IMAGES | OPTIONAL) > 5


def test_blocked_import_would_be_noticed() -> None:
    with pytest.raises(AssertionError, match="blocked: numpy"):
        import_all("bake", {"numpy"})


def test_root_imports_nothing_of_blender_before_register() -> None:
    code = "import sys, measured_materials; sys.exit('bpy' in sys.modules or 'numpy' in sys.modules)"
    subprocess.run([sys.executable, "-P", "-c", code], check=True, timeout=60)


def test_tested_code_is_this_clone() -> None:
    assert Path(__file__).resolve().parents[1] == ROOT.resolve()
