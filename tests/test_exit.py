"""A script that registers the extension in Blender's Python module ends by itself, with its own exit code."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import pytest
from measured_materials.nodes import compat

ENDINGS = {
    "the last line": ("", 0),
    "sys.exit(7)": ("import sys\nsys.exit(7)\n", 7),
    "an exception": ("raise RuntimeError('of the script')\n", 1),
    "unregistered by itself": ("measured_materials.unregister()\n", 0),
    "registered again": ("measured_materials.unregister()\nmeasured_materials.register()\nraise SystemExit(7)\n", 7),
    "after a file": ("bpy.ops.wm.read_homefile(use_empty=True)\nraise SystemExit(7)\n", 7),
}


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_script_ends_with_its_own_code(ending: str) -> None:
    """bpy 4.5 crashed (139) or never ended where a Python function was left in its handlers."""
    words, code = ENDINGS[ending]
    script = f"import bpy\nimport measured_materials\nmeasured_materials.register()\n{words}"
    done = subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == code, done.stderr
    assert ("of the script" in done.stderr) == (code == 1) and done.stderr.count("Traceback") == (code == 1)


def test_the_application_is_told_from_the_module_in_every_version(monkeypatch: pytest.MonkeyPatch) -> None:
    """`bpy.app.module` is younger than the oldest version: in 4.3 the extension would not register by asking for it."""
    for app, expected in (
        (SimpleNamespace(binary_path="/usr/bin/blender"), False),
        (SimpleNamespace(binary_path=""), True),
        (SimpleNamespace(binary_path="/usr/bin/blender", module=False), False),
        (SimpleNamespace(binary_path="/usr/bin/blender", module=True), True),  # scripts may set the path
    ):
        monkeypatch.setattr(compat, "bpy", SimpleNamespace(app=app))
        assert compat.is_module() is expected
    monkeypatch.undo()
    assert compat.is_module()
