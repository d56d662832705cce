"""What `tests/real_blender` lays before a Blender: all that its programs read there, whichever of them is called."""

from __future__ import annotations

import ast
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

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
