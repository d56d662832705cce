"""What `tests/real_blender` lays before a Blender, sets there, and says of what it found."""

from __future__ import annotations

import ast
import importlib
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from measured_materials.addon.ui.import_photographs import MEASURED_MATERIALS_OT_import_arc as Photographs
from measured_materials.addon.ui.properties.photographs import _shown

PROGRAMS = Path(__file__).resolve().parent / "real_blender"


class _Reached(Exception):
    """All is laid out, and the Blender would be started."""


def swatches_read() -> set[str]:
    """Bundles of swatches by name, as the programs call them that only Blender can run."""
    cases = ast.parse((PROGRAMS / "lamp_cases.py").read_text(encoding="utf-8"))
    given = {n.value for n in ast.walk(cases) if isinstance(n, ast.keyword) and n.arg == "swatch"}
    found = {str(ast.literal_eval(value)) for value in given}
    stack = ast.parse((PROGRAMS / "stack.py").read_text(encoding="utf-8"))
    maps = next(n.value for n in stack.body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "_MAPS")
    return found | {f"swatch_{model}" for model in ast.literal_eval(maps)}


def taken_from_ours(program: Path) -> set[tuple[str, str]]:
    """Modules of the extension that a program asks for by `ours`, and the names that it takes from each."""
    tree = ast.parse(program.read_text(encoding="utf-8"))

    def module(node: ast.AST) -> str:
        asked = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "ours"
        return str(node.args[0].value) if asked and isinstance(node.args[0], ast.Constant) else ""

    found = set()
    for scope in [tree, *(n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))]:
        known = {}
        for given in (n for n in ast.walk(scope) if isinstance(n, ast.Assign)):
            for target in given.targets:
                pairs = [(target, given.value)]
                if isinstance(target, ast.Tuple) and isinstance(given.value, ast.Tuple):
                    pairs = list(zip(target.elts, given.value.elts, strict=True))
                known |= {one.id: module(value) for one, value in pairs if isinstance(one, ast.Name) and module(value)}
        for node in (n for n in ast.walk(scope) if isinstance(n, ast.Attribute)):
            name = known.get(node.value.id, "") if isinstance(node.value, ast.Name) else module(node.value)
            found |= {(name, node.attr)} if name else set()
    return found


@pytest.mark.parametrize("program", sorted(PROGRAMS.glob("*.py")), ids=lambda path: path.stem)
def test_what_the_programs_take_is_there(program: Path) -> None:
    """Else one of them fails only where it is run, in a Blender."""
    for module, name in sorted(taken_from_ours(program)):
        assert hasattr(importlib.import_module(f"measured_materials.{module}"), name), f"{module}.{name}"


@pytest.fixture
def modules() -> Iterator[None]:
    """The programs' own modules are of their folder, and gone afterwards."""
    before, path = set(sys.modules), list(sys.path)
    sys.path.insert(0, str(PROGRAMS))
    yield
    sys.path[:] = path
    for name in set(sys.modules) - before:
        if Path(getattr(sys.modules[name], "__file__", None) or "").parent == PROGRAMS:
            del sys.modules[name]


@pytest.mark.parametrize("program", ["check", "lamps_agree"])
def test_swatches_lie_where_the_programs_read_them(
    modules: None, monkeypatch: pytest.MonkeyPatch, program: str
) -> None:
    """Without one of them its check fails in every Blender that has a Raycast node, and in no other."""
    seen: dict[str, set[str]] = {}

    def install(blender: object) -> str:
        share: Path = blender.share  # type: ignore[attr-defined]
        seen["bundles"] = {folder.stem for folder in share.glob("*.mmat") if (folder / "material.json").is_file()}
        seen["programs"] = {file.stem for file in share.glob("*.py")}
        raise _Reached

    import application  # type: ignore[import-not-found]

    monkeypatch.setattr(application.Blender, "install", install)
    monkeypatch.setattr(sys, "argv", [f"{program}.py", "nowhere"])
    with pytest.raises(_Reached):
        runpy.run_path(str(PROGRAMS / f"{program}.py"), run_name="__main__")
    wanted = swatches_read()
    assert len(wanted) >= 4 and wanted <= seen["bundles"]
    assert {"unbiased", "stack", "lamp_cases", "world_cases", "common"} <= seen["programs"]


def settings_of_photographs() -> SimpleNamespace:
    """What the operator begins with."""
    properties = bpy.ops.measured_materials.import_arc.get_rna_type().properties
    return SimpleNamespace(**{p.identifier: getattr(p, "default", None) for p in properties})


def rows(settings: SimpleNamespace) -> dict[str, int]:
    """Of each tab of the photographs' dialogue."""

    class Layout:
        rows = 0

        def column(self) -> Layout:
            return self

        def prop(self, *_: Any, **__: Any) -> None:
            self.rows += 1

    known = bpy.ops.measured_materials.import_arc.get_rna_type().properties
    high = {p.identifier: max(1, getattr(p, "array_length", 0) // 2) for p in known}  # two numbers in a row
    found = {part: sum(high[name] for name in names) for part, names in _shown(settings, settings).items()}
    for settings.part in ("rendering", "through"):
        layout = Layout()
        Photographs._draw_in_part(settings, layout)
        found[settings.part] = found.get(settings.part, 0) + layout.rows
    return found


def test_the_dialogue_is_measured_where_it_is_highest(registered: None) -> None:
    """No other choice adds a row to those that a real Blender is shown."""
    source = ast.parse((PROGRAMS / "tutorial_dialogues.py").read_text(encoding="utf-8"))
    chosen = next(n.value for n in source.body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "_HIGHEST")
    settings = settings_of_photographs()
    usual = rows(settings)
    for name, value in ast.literal_eval(chosen).items():
        assert hasattr(settings, name), name
        setattr(settings, name, value)
    most = rows(settings)
    assert sum(most.values()) > sum(usual.values()) + 10
    # At twice the size a screen of 1080 lines holds these beside the dialogue's other rows.
    assert max(most.values()) <= 11, most
    for p in bpy.ops.measured_materials.import_arc.get_rna_type().properties:
        others = {"BOOLEAN": (False, True), "FLOAT": (0.0, 0.5), "STRING": ("", "a")}.get(p.type, ())
        for other in p.enum_items.keys() if p.type == "ENUM" else others:
            changed = SimpleNamespace(**{**vars(settings), p.identifier: other})
            assert sum(rows(changed).values()) <= sum(most.values()), (p.identifier, other)


def test_a_blender_in_which_sheets_cannot_be_seen_is_told(
    modules: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Silence would look like success."""
    import sheets  # type: ignore[import-not-found]

    class Old:
        def __init__(self, *_: object) -> None:
            pass

        def install(self) -> str:
            return "Blender 4.5"

        def run(self, *_: str) -> str:
            return f"sheets: {sheets.NO_RAYCAST}\nsheets: all is well\n"

    assert f"sheets: {sheets.NO_RAYCAST}" in (PROGRAMS / "sheets_inside.py").read_text(encoding="utf-8")
    for name in ("bake_source", "record_of"):
        monkeypatch.setattr(sheets, name, lambda *_: None)
    monkeypatch.setattr(sheets, "Blender", Old)
    sheets.main(Path("nowhere"), [])
    assert "skipped: no Raycast node" in capsys.readouterr().out


def imported(preview: float, beside: tuple[float, float], load: float) -> dict[str, Any]:
    """What a walk found: the first picture, and the final one by clock and processor; in process it takes 10 s."""
    runs = {"beside": beside, "in process": (10.0, 10.0)}
    final = {place: [{"clock": clock, "processor": spent}] * 2 for place, (clock, spent) in runs.items()}
    return {"seconds_to_preview": {"clock": preview, "processor": 1.0}, "load": load, "final": final}


@pytest.mark.parametrize(
    "preview, beside, late, told",
    [
        (1.0, (10.5, 12.0), "", ""),
        (3.0, (10.5, 10.0), "the first picture", "not judged"),
        (1.0, (20.0, 10.0), "longer than in process", "excused by processor time"),
    ],
)
def test_waiting_without_work_is_late_too(
    modules: None, capsys: pytest.CaptureFixture[str], preview: float, beside: tuple[float, float], late: str, told: str
) -> None:
    """A window that is idle while an artist waits; only on a machine that did other things it is excused, and told."""
    desk = __import__("desk")
    found = desk.too_late(imported(preview, beside, load=0.2))
    assert (late in found if late else not found) and not capsys.readouterr().out
    assert not desk.too_late(imported(preview, beside, load=99.0))
    said = capsys.readouterr().out
    assert (told in said and "load of 99.0" in said) if told else not said


def test_work_is_no_excuse(modules: None) -> None:
    """A bake that takes longer by the processor as well, however busy the machine is."""
    assert "longer than in process" in __import__("desk").too_late(imported(1.0, (20.0, 15.0), load=99.0))
