"""Timers may write where Blender forbids it by mistake: an operator's `poll` forbids it as a panel's `draw` does."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import measured_materials
import pytest
from measured_materials.addon import events

pytestmark = pytest.mark.usefixtures("registered")
ADDON = Path(measured_materials.__file__).parent / "addon"


@pytest.fixture
def where_forbidden() -> Iterator[Callable[[Callable[[], Any]], Any]]:
    """Calls a function where Python may not write, and returns or raises what it does."""
    calls: list[Callable[[], Any]] = []
    done: list[Any] = []

    class MM_TEST_OT_forbidding(bpy.types.Operator):
        bl_idname, bl_label = "mm_test.forbidding", "Forbidding"

        @classmethod
        def poll(cls, _context: bpy.types.Context) -> bool:
            for call in calls:
                try:
                    done.append((call(), None))
                except Exception as error:
                    done.append((None, error))
            calls.clear()
            return True

        def execute(self, _context: bpy.types.Context) -> set[str]:
            return {"FINISHED"}

    def within(call: Callable[[], Any]) -> Any:
        calls.append(call)
        bpy.ops.mm_test.forbidding.poll()
        result, error = done.pop()
        if error is not None:
            raise error
        return result

    bpy.utils.register_class(MM_TEST_OT_forbidding)
    try:
        yield within
    finally:
        bpy.utils.unregister_class(MM_TEST_OT_forbidding)


def writes() -> float:
    """As the timers do: a value of a datablock, and an operator."""
    bpy.context.scene.frame_end = 251
    bpy.ops.measured_materials.tell(words="written")
    return 0.25


def test_blender_forbids_it(where_forbidden: Any) -> None:
    with pytest.raises(AttributeError, match="not allowed"):
        where_forbidden(writes)


def test_a_timer_may_write_all_the_same(where_forbidden: Any) -> None:
    before = bpy.context.scene.frame_end
    try:
        bpy.context.scene.frame_end = 250
        assert where_forbidden(events.timer(writes)) == 0.25
        assert bpy.context.scene.frame_end == 251
        with pytest.raises(AttributeError, match="not allowed"):  # to all others it stays forbidden
            where_forbidden(writes)
    finally:
        bpy.context.scene.frame_end = before


def test_an_error_comes_out_of_a_timer(where_forbidden: Any) -> None:
    def fails() -> float:
        raise ValueError("a defect")

    with pytest.raises(ValueError, match="a defect"):
        where_forbidden(events.timer(fails))
    assert events.timer(writes)() == 0.25


def test_every_timer_may_write() -> None:
    """What is registered anywhere in the add-on is such a function of the same file."""
    found = 0
    for file in sorted(ADDON.rglob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        nodes = list(ast.walk(tree))
        timers = {
            node.name
            for node in nodes
            if isinstance(node, ast.FunctionDef)
            and any(ast.unparse(decorator).rpartition(".")[2] == "timer" for decorator in node.decorator_list)
        }
        for node in nodes:
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("app.timers.register"):
                assert ast.unparse(node.args[0]) in timers, f"{file.name}:{node.lineno}"
                found += 1
    assert found >= 7
