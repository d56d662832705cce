"""A .blend of the version before: its materials, properties and custom keys are understood, and keep working."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

# Run apart: opening a file would take the scene of every other test away.
# The version before had two property groups with a mode; a shading map's was that of its lighting.
MAKE = """
import json, sys
from pathlib import Path
import bpy
import measured_materials
from measured_materials.addon.lights import light_tables as lamps
from measured_materials.addon.material.facts import facts_of
from measured_materials.addon.material.textures.kept import image_nodes
from measured_materials.addon.material.kinds import kind_of
from support.stacks import write_stack

folder = Path(sys.argv[1])
MODES = [(name, name, "") for name in ("preview", "balanced", "exact", "reference")]
WAYS = [(name, name, "") for name in ("auto", "always", "never")]


class Quality(bpy.types.PropertyGroup):
    mode: bpy.props.EnumProperty(items=MODES, default="exact")
    aim: bpy.props.EnumProperty(items=WAYS, default="auto")
    problem: bpy.props.StringProperty(options={"SKIP_SAVE"})


class Lighting(bpy.types.PropertyGroup):
    lobe: bpy.props.EnumProperty(items=[(name, name, "") for name in ("lambert", "oren_nayar", "ggx")])
    sigma: bpy.props.FloatProperty()
    mode: bpy.props.EnumProperty(items=MODES, default="exact")
    problem: bpy.props.StringProperty(options={"SKIP_SAVE"})


def as_the_version_before(material, mode, lobe, sigma, aim):
    "Let these be its properties, as stored by the groups that it had."
    measured_materials.unregister()
    for kind in (Quality, Lighting):
        bpy.utils.register_class(kind)
    bpy.types.Material.measured_quality = bpy.props.PointerProperty(type=Quality)
    bpy.types.Material.measured_lighting = bpy.props.PointerProperty(type=Lighting)
    material.measured_quality.property_unset("mode")
    material.measured_quality.aim = aim
    light = material.measured_lighting
    light.lobe, light.sigma, light.mode = lobe, sigma, mode
    material.use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "older.blend"))
    found = {name: getattr(light, name) for name in ("mode", "lobe")} | {"quality": material.measured_quality.mode}
    del bpy.types.Material.measured_quality, bpy.types.Material.measured_lighting
    for kind in (Quality, Lighting):
        bpy.utils.unregister_class(kind)
    return found


def state(material):
    light, quality = material.measured_lighting, material.measured_quality
    return {
        "mode": quality.mode, "aim": quality.aim, "lobe": light.lobe, "sigma": round(light.sigma, 6),
        "problem": quality.problem + light.problem, "built": facts_of(material)["render"]["mode"],
        "lobe built": facts_of(material)["render"]["lobe"]["name"],
        "images": sorted(node.image.name for node in image_nodes(material.node_tree)),
        "lost": kind_of(material).why_not_rebuildable(material),
    }


measured_materials.register()
bpy.ops.wm.read_homefile(use_empty=True)
bpy.context.scene.collection.objects.link(bpy.data.objects.new("plate", bpy.data.meshes.new("plate")))
bpy.context.view_layer.objects.active = bpy.data.objects["plate"]
bpy.ops.measured_materials.import_arc(filepath=str(write_stack(folder / "felt")), bundles=str(folder))
felt = bpy.data.materials["felt"]
felt.measured_lighting.lobe, felt.measured_lighting.sigma = "ggx", 0.5
felt.measured_quality.aim, felt.measured_quality.mode = "always", "reference"
now = state(felt)
stored = as_the_version_before(felt, "reference", "ggx", 0.5, "always")
"""
TELL = """
measured_materials.unregister()  # a handler left in place would keep the process from ending
print("found:", json.dumps(found))
"""
OPEN = """
measured_materials.register()
bpy.ops.wm.open_mainfile(filepath=str(folder / "older.blend"))
felt = bpy.data.materials["felt"]
found = {"now": now, "stored": stored, "opened": state(felt), "datablocks": len(bpy.data.materials)}
felt.measured_lighting.sigma = 0.9
found["relit"] = state(felt)
felt.measured_quality.aim = "never"
felt.measured_quality.mode = "balanced"
found["changed"] = state(felt)
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "newer.blend"))
bpy.ops.wm.open_mainfile(filepath=str(folder / "newer.blend"))
found["again"] = state(bpy.data.materials["felt"])
"""
BRING = """
measured_materials.register()
bpy.ops.wm.read_homefile(use_empty=True)
found = {}
for name, link in (("appended", False), ("linked", True)):
    with bpy.data.libraries.load(str(folder / "older.blend"), link=link) as (there, here):
        here.materials = ["felt"]
    bpy.ops.wm.append(directory=str(folder / "older.blend") + "/Material/", filename="felt", link=link)
    materials = [m for m in bpy.data.materials if (m.library is not None) == link]
    found[name] = [state(material)["mode"] for material in materials]
"""
UPDATE = """
# The extension is exchanged while the file is open.
bpy.ops.wm.open_mainfile(filepath=str(folder / "older.blend"))
measured_materials.register()
found = {"opened": state(bpy.data.materials["felt"])}
"""


def run(folder: Path, script: str) -> dict[str, Any]:
    code = f"import sys\nsys.path.insert(0, {str(Path(__file__).parent)!r})\n{MAKE}{script}{TELL}"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, str(folder)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("found: "))[7:])


def test_the_mode_of_the_lighting_is_taken_over(tmp_path: Path) -> None:
    found = run(tmp_path, OPEN)
    # Without this the file would prove nothing.
    assert found["stored"] == {"mode": "reference", "lobe": "ggx", "quality": "exact"}
    now = found["now"]
    assert (now["mode"], now["built"], now["lobe built"]) == ("reference", "reference", "ggx") and not now["problem"]
    assert found["opened"] == now and found["datablocks"] == 1
    assert found["relit"] == {**now, "sigma": 0.9}
    changed = {**now, "sigma": 0.9, "aim": "never", "mode": "balanced", "built": "balanced"}
    found["changed"]["images"] = now["images"] = changed["images"] = []
    found["again"]["images"] = []
    assert found["changed"] == found["again"] == changed


@pytest.mark.parametrize("name", ["appended", "linked"])
def test_so_is_that_of_what_comes_from_another_file(name: str, brought: dict[str, Any]) -> None:
    assert set(brought[name]) == {"reference"}


@pytest.fixture(scope="module")
def brought(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return run(tmp_path_factory.mktemp("brought"), BRING)


def test_so_it_is_where_the_extension_is_exchanged(tmp_path: Path) -> None:
    assert run(tmp_path, UPDATE)["opened"]["mode"] == "reference"
