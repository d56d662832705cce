"""The seams of the four folders: who may import what, read from the source and proved by importing; no circles."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import measured_materials
import pytest

ROOT = Path(measured_materials.__file__).parent
BLENDER = {"bpy", "bpy_extras", "bmesh", "mathutils", "gpu", "gpu_extras", "blf", "bl_ui", "idprop"}
IMAGES = {"OpenEXR", "OpenImageIO"}
# Not in Blender, used where present: readers of Keras' weights.
HDF5 = {"h5py", "pyfive"}
OPTIONAL = {"scipy", "matplotlib", "rich", "mitsuba", "drjit", "PIL", "distributed"}

# What each folder may import of the others, and of packages that are not Python's own.
INSIDE = {"bake": {"bake"}, "nodes": {"nodes", "bake"}, "addon": {"addon", "nodes", "bake"}}
OUTSIDE = {
    "bake": {"numpy"} | IMAGES | HDF5,
    "nodes": {"numpy"} | BLENDER,
    "addon": {"numpy"} | IMAGES | BLENDER,
}


class Import(NamedTuple):
    where: str
    level: int
    module: str
    deferred: bool


@cache
def imports(folder: str) -> tuple[Import, ...]:
    """Every import of a folder; `module` is counted from the repository root if it is relative."""
    return tuple(_read_imports(folder))


def _read_imports(folder: str) -> Iterator[Import]:
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


def import_graph() -> dict[str, set[str]]:
    """Of each module of the product, the modules it imports: those for the type checker and inside functions too."""
    files = {file for folder in INSIDE for file in (ROOT / folder).rglob("*.py")}
    modules = {_module(file.relative_to(ROOT)) for file in files}
    graph: dict[str, set[str]] = {name: set() for name in modules}
    for found in (found for folder in INSIDE for found in imports(folder) if found.level):
        name = _module(Path(found.where.partition(":")[0]))
        # What is imported from a module is one itself, or is defined in it.
        target = found.module if found.module in modules else found.module.rpartition(".")[0]
        if target in modules and target != name:
            graph[name].add(target)
    return graph


def _module(file: Path) -> str:
    parts = file.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """What can be reached from each of its members by arrows and reaches that again; lone members left out."""
    reached = {name: _reached(graph, name) for name in graph}
    found = [{b for b in reached[a] if a in reached[b]} for a in graph if a in reached[a]]
    return [circle for k, circle in enumerate(found) if circle not in found[:k]]


def _reached(graph: dict[str, set[str]], start: str) -> set[str]:
    seen: set[str] = set()
    ahead = set(graph[start])
    while ahead:
        seen |= ahead
        ahead = {c for b in ahead for c in graph[b]} - seen
    return seen


def of_packages(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """The same arrows between the folders that the modules lie in."""
    folders = {name: name if (ROOT / name.replace(".", "/")).is_dir() else name.rpartition(".")[0] for name in graph}
    folded: dict[str, set[str]] = {folder: set() for folder in folders.values()}
    for name, targets in graph.items():
        folded[folders[name]] |= {folders[target] for target in targets} - {folders[name]}
    return folded


def test_no_modules_import_each_other_in_a_circle() -> None:
    """By whatever detour, and wherever in the file: a circle is two floors in one file."""
    graph = import_graph()
    assert len(graph) > 200 and "bake.brdf.record" in graph["addon.material.rebuild"]
    assert circles(graph) == []


def test_no_packages_import_each_other_in_a_circle() -> None:
    graph = of_packages(import_graph())
    assert "addon.ui" in graph and "nodes" in graph["addon.material"]
    assert circles(graph) == []


def test_no_folder_holds_more_files_than_one_can_survey() -> None:
    """`nodes` is flat on purpose: one group in one file."""
    counts = {
        folder: len([f for f in folder.glob("*.py") if f.name != "__init__.py"])
        for top in ("bake", "addon")
        for folder in [ROOT / top, *(ROOT / top).rglob("*/")]
    }
    assert max(counts.values()) <= 15, max(counts, key=lambda folder: counts[folder])


def test_circles_are_found() -> None:
    """By two arrows, by three, through a package's own file; not where arrows only meet again."""
    assert circles({"a": {"b"}, "b": {"a"}, "c": {"a"}}) == [{"a", "b"}]
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == [{"a", "b", "c"}]
    assert circles({"a": {"b", "c"}, "b": {"d"}, "c": {"d"}, "d": set()}) == []
    graph = import_graph()
    graph["addon.material.choices"].add("addon.material.rebuild")
    assert [circle for circle in circles(graph) if "addon.material.choices" in circle]
    assert of_packages({"addon.a": {"addon.gantry.swatches.b"}, "addon.gantry.swatches.b": set()}) == {
        "addon": {"addon.gantry.swatches"},
        "addon.gantry.swatches": set(),
    }


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


# Where a document from anywhere is read; everything else takes a record, which was checked there.
READERS = {"bake/bundle/checked_json.py", "bake/bundle/bundle.py"}


def test_documents_are_read_by_the_records_alone() -> None:
    """`require` is how an entry of an untrusted document is read: its callers are the records' own `Fields`."""
    found = {
        file.relative_to(ROOT).as_posix()
        for folder in INSIDE
        for file in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and "require" in (getattr(node.func, "id", ""), getattr(node.func, "attr", ""))
    }
    assert found == READERS


def test_fields_of_a_document_are_made_where_records_are() -> None:
    """`Fields` is made of a document in the records; elsewhere only of what is no bundle's."""
    found = {
        file.relative_to(ROOT).as_posix()
        for folder in INSIDE
        for file in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Fields"
    }
    records = {
        "bake/bundle/checked_json.py",
        "bake/brdf/common.py",
        "bake/brdf/parts.py",
    }
    # What `inspect` shows of measurements and photographs that are not baked.
    assert found == records | {"addon/cli/inspect.py"}


def test_names_in_texts_are_those_of_the_code() -> None:
    """`bake.tables.table.Table` in a docstring or on a page is a module, and what is defined or imported there."""
    named = re.compile(r"`((?:addon|bake|nodes)\.[a-z_]\w*(?:\.\w+)*)(?:\(\))?`")
    files = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "addon" / "docs").glob("*.md")]
    files += [file for folder in INSIDE for file in (ROOT / folder).rglob("*.py")]
    wrong = [
        f"{file.relative_to(ROOT)}: {name}"
        for file in files
        for name in named.findall(file.read_text(encoding="utf-8"))
        if not _is_defined(name.split("."))
    ]
    assert not wrong


def _is_defined(parts: list[str]) -> bool:
    for count in range(len(parts), 0, -1):
        place = ROOT.joinpath(*parts[:count])
        file = place.with_suffix(".py") if place.with_suffix(".py").is_file() else place / "__init__.py"
        if file.is_file():
            names = set(re.findall(r"\w+", file.read_text(encoding="utf-8")))
            return set(parts[count:]) <= names
    return False
